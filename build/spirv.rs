//! Look-ups in a SPIR-V module: names, decorations and definitions by id.

use rspirv::binary::{Consumer, ParseAction, parse_words};
use rspirv::dr::{Instruction, ModuleHeader, Operand};
use rspirv::spirv::{Decoration, Op};
use std::collections::HashMap;

/// The declarations of a module before its first function. (`rspirv`'s own module loader does not support
/// `OpExecutionModeId`, by which SPIR-V 1.6 declares the workgroup size; reflection refuses it by name.)
#[derive(Default)]
pub(crate) struct Globals {
    lines: Vec<Instruction>,
    complete: bool,
}

impl Globals {
    pub(crate) fn parse(words: &[u32]) -> Result<Globals, String> {
        let mut globals = Globals::default();
        parse_words(words, &mut globals).map_err(|error| error.to_string())?;
        Ok(globals)
    }

    pub(crate) fn lines(&self) -> &[Instruction] {
        &self.lines
    }
}

impl Consumer for Globals {
    fn initialize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn finalize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_header(&mut self, _header: ModuleHeader) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_instruction(&mut self, line: Instruction) -> ParseAction {
        self.complete |= line.class.opcode == Op::Function;
        if !self.complete {
            self.lines.push(line);
        }
        ParseAction::Continue
    }
}

/// A decoration with the number it may carry.
type Decorated = (Decoration, Option<u32>);

/// The annotations of a module, by id.
pub(crate) struct Index<'a> {
    names: HashMap<u32, &'a str>,
    member_names: HashMap<(u32, u32), &'a str>,
    decorations: HashMap<(u32, Option<u32>), Vec<Decorated>>,
    definitions: HashMap<u32, &'a Instruction>,
}

impl<'a> Index<'a> {
    pub(crate) fn new(globals: &'a Globals) -> Index<'a> {
        let mut index = Index {
            names: HashMap::new(),
            member_names: HashMap::new(),
            decorations: HashMap::new(),
            definitions: HashMap::new(),
        };
        for line in globals.lines() {
            if let Some(id) = line.result_id {
                index.definitions.insert(id, line);
            }
            match (line.class.opcode, line.operands.as_slice()) {
                (Op::Name, [Operand::IdRef(id), Operand::LiteralString(name)]) => {
                    index.names.insert(*id, name);
                }
                (Op::MemberName, [Operand::IdRef(id), member, Operand::LiteralString(name)]) => {
                    index.member_names.insert((*id, bits(member)), name);
                }
                (Op::Decorate, [Operand::IdRef(id), rest @ ..]) => {
                    index.decorate(*id, None, rest);
                }
                (Op::MemberDecorate, [Operand::IdRef(id), member, rest @ ..]) => {
                    index.decorate(*id, Some(bits(member)), rest);
                }
                _ => {}
            }
        }
        index
    }

    fn decorate(&mut self, id: u32, member: Option<u32>, rest: &[Operand]) {
        if let [Operand::Decoration(decoration), value @ ..] = rest {
            let all = self.decorations.entry((id, member)).or_default();
            all.push((*decoration, value.first().map(bits)));
        }
    }

    /// Source name of an id; empty if it has none.
    pub(crate) fn name(&self, id: u32) -> &'a str {
        self.names.get(&id).copied().unwrap_or_default()
    }

    pub(crate) fn member_name(&self, id: u32, member: u32) -> &'a str {
        let name = self.member_names.get(&(id, member));
        name.copied().unwrap_or_default()
    }

    /// True if an id, or a member of it, carries a decoration.
    pub(crate) fn is(&self, id: u32, member: Option<u32>, wanted: Decoration) -> bool {
        self.find(id, member, wanted).is_some()
    }

    /// Number of a decoration, such as an offset or a binding.
    pub(crate) fn value(&self, id: u32, member: Option<u32>, wanted: Decoration) -> Option<u32> {
        self.find(id, member, wanted)?
    }

    fn find(&self, id: u32, member: Option<u32>, wanted: Decoration) -> Option<Option<u32>> {
        let all = self.decorations.get(&(id, member))?;
        let found = all.iter().find(|(decoration, _)| *decoration == wanted);
        found.map(|(_, value)| *value)
    }

    /// The type, constant or variable of that id.
    pub(crate) fn definition(&self, id: u32) -> Result<&'a Instruction, String> {
        let found = self.definitions.get(&id).copied();
        found.ok_or_else(|| format!("the SPIR-V defines no %{id}"))
    }

    /// The value of an integer constant.
    pub(crate) fn constant(&self, id: u32) -> Result<u32, String> {
        let line = self.definition(id)?;
        match (line.class.opcode, line.operands.as_slice()) {
            (Op::Constant, [value]) => Ok(bits(value)),
            _ => Err("an array that both worlds see needs a plain number as its length".to_owned()),
        }
    }
}

/// Bits of a 32-bit operand, ids included.
pub(crate) fn bits(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(value) | Operand::IdRef(value) => *value,
        _ => 0,
    }
}
