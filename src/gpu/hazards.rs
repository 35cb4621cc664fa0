//! Placement of barriers from the declared reads and writes of commands.
//!
//! Pure bookkeeping over resource ids: a barrier is needed exactly if an access of a command conflicts with one since
//! the last barrier.

use crate::shader::Access;
use std::collections::HashSet;

/// Resources read and written since the last barrier.
#[derive(Debug, Default)]
pub struct Hazards {
    read: HashSet<u64>,
    written: HashSet<u64>,
}

impl Hazards {
    /// Adds a command's accesses; returns true if it needs a barrier before it.
    pub fn command(&mut self, accesses: &[(u64, Access)]) -> bool {
        let conflict = accesses
            .iter()
            .any(|&(id, access)| self.written.contains(&id) || (access != Access::Read && self.read.contains(&id)));
        if conflict {
            self.barrier();
        }
        for &(id, access) in accesses {
            if access != Access::Write {
                self.read.insert(id);
            }
            if access != Access::Read {
                self.written.insert(id);
            }
        }
        conflict
    }

    /// Clears all accesses, after a barrier recorded for another reason.
    pub fn barrier(&mut self) {
        self.read.clear();
        self.written.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn conflicts(a: &[(u64, Access)], b: &[(u64, Access)]) -> bool {
        a.iter().any(|&(x, how_x)| {
            b.iter()
                .any(|&(y, how_y)| x == y && (how_x != Access::Read || how_y != Access::Read))
        })
    }

    fn command() -> impl Strategy<Value = Vec<(u64, Access)>> {
        let access = prop_oneof![Just(Access::Read), Just(Access::Write), Just(Access::ReadWrite)];
        proptest::collection::vec((0u64..5, access), 1..4)
    }

    proptest! {
        /// Every conflicting pair is separated by a barrier, and every barrier separates one.
        #[test]
        fn barriers_stand_where_accesses_conflict(commands in proptest::collection::vec(command(), 0..20)) {
            let mut hazards = Hazards::default();
            let mut since: Vec<&Vec<(u64, Access)>> = Vec::new();
            for command in &commands {
                let needed = since.iter().any(|earlier| conflicts(earlier, command));
                prop_assert_eq!(hazards.command(command), needed);
                if needed {
                    since.clear();
                }
                since.push(command);
            }
        }
    }
}
