//! Placement of barriers from the declared reads and writes of commands.
//!
//! Pure bookkeeping over resource ids: a barrier is needed exactly if an access of a command conflicts with one that no
//! barrier orders before it. Between kernels a barrier orders accesses of shaders alone: one that reaches transfers and
//! indirect arguments as well makes some devices wait longer.

use crate::shader::Access;
use std::collections::HashSet;

/// Later accesses that a barrier orders behind all earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// Those of shaders.
    Shaders,
    /// Those of shaders, transfers and indirect arguments.
    All,
}

/// Resources read and written since a barrier.
#[derive(Debug, Default)]
struct Accesses {
    read: HashSet<u64>,
    written: HashSet<u64>,
}

impl Accesses {
    fn conflict(&self, with: &[(u64, Access)]) -> bool {
        with.iter()
            .any(|&(id, access)| self.written.contains(&id) || (access != Access::Read && self.read.contains(&id)))
    }

    fn add(&mut self, accesses: &[(u64, Access)]) {
        for &(id, access) in accesses {
            if access != Access::Write {
                self.read.insert(id);
            }
            if access != Access::Read {
                self.written.insert(id);
            }
        }
    }

    fn clear(&mut self) {
        self.read.clear();
        self.written.clear();
    }
}

/// Accesses that are not yet ordered before later ones.
#[derive(Debug, Default)]
pub(super) struct Hazards {
    /// Before later ones of shaders.
    shaders: Accesses,
    /// Before later ones of transfers and indirect arguments.
    others: Accesses,
}

impl Hazards {
    /// Adds a command's accesses: of its shader, and of a transfer or an indirect dispatch. Returns the barrier that it
    /// needs before it.
    pub(super) fn command(&mut self, shader: &[(u64, Access)], other: &[(u64, Access)]) -> Option<Reach> {
        let reach = if self.others.conflict(other) {
            self.barrier();
            Some(Reach::All)
        } else if self.shaders.conflict(shader) {
            self.shaders.clear();
            Some(Reach::Shaders)
        } else {
            None
        };
        for accesses in [shader, other] {
            self.shaders.add(accesses);
            self.others.add(accesses);
        }
        reach
    }

    /// Clears all accesses, after a barrier recorded for another reason.
    pub(super) fn barrier(&mut self) {
        self.shaders.clear();
        self.others.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Accesses of the shader, and the others.
    type Command = (Vec<(u64, Access)>, Vec<(u64, Access)>);

    fn conflicts(a: &[(u64, Access)], b: &[(u64, Access)]) -> bool {
        a.iter().any(|&(x, how_x)| {
            b.iter()
                .any(|&(y, how_y)| x == y && (how_x != Access::Read || how_y != Access::Read))
        })
    }

    fn conflicts_with_any(earlier: &[&Command], with: &[(u64, Access)]) -> bool {
        earlier.iter().any(|(a, b)| conflicts(a, with) || conflicts(b, with))
    }

    fn accesses() -> impl Strategy<Value = Vec<(u64, Access)>> {
        let access = prop_oneof![Just(Access::Read), Just(Access::Write), Just(Access::ReadWrite)];
        proptest::collection::vec((0u64..5, access), 0..3)
    }

    proptest! {
        /// Every conflicting pair is separated by a barrier that reaches the later one, and every barrier separates
        /// one.
        #[test]
        fn barriers_stand_where_accesses_conflict(
            commands in proptest::collection::vec((accesses(), accesses()), 0..20)
        ) {
            let mut hazards = Hazards::default();
            let mut before_shaders: Vec<&Command> = Vec::new();
            let mut before_others: Vec<&Command> = Vec::new();
            for command in &commands {
                let (shader, other) = command;
                let all = conflicts_with_any(&before_others, other);
                let shaders = conflicts_with_any(&before_shaders, shader);
                let needed = if all { Some(Reach::All) } else { shaders.then_some(Reach::Shaders) };
                prop_assert_eq!(hazards.command(shader, other), needed);
                if needed.is_some() {
                    before_shaders.clear();
                }
                if all {
                    before_others.clear();
                }
                before_shaders.push(command);
                before_others.push(command);
            }
        }
    }
}
