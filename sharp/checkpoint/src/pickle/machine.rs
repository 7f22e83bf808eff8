//! The opcodes of pickle protocols 2 to 5 that PyTorch writes.

use std::collections::HashMap;

use crate::error::{Fault, MAX_PICKLE_LEN, malformed};

use super::value::{Global, Heap, Value};

/// Maximum number of opcodes; a tensor takes about 45, each of which allocates some tens of bytes.
const MAX_STEPS: usize = 1 << 19;

/// Runs the pickle at the start of `bytes`; returns its object and its length in bytes.
pub(crate) fn load<'a>(bytes: &'a [u8], heap: &mut Heap<'a>) -> Result<(Value<'a>, usize), Fault> {
    let mut machine = Machine {
        bytes: &bytes[..bytes.len().min(MAX_PICKLE_LEN)],
        at: 0,
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
        heap,
    };
    for _ in 0..MAX_STEPS {
        if let Some(value) = machine.step()? {
            return Ok((value, machine.at));
        }
    }
    malformed!("pickle: more than {MAX_STEPS} operations")
}

struct Machine<'a, 'h> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value<'a>>,
    /// Stack height at each open mark; values below the last mark may not be popped.
    marks: Vec<usize>,
    /// Values that the pickle stored for later use, by number.
    memo: HashMap<u32, Value<'a>>,
    heap: &'h mut Heap<'a>,
}

impl<'a> Machine<'a, '_> {
    /// Runs one opcode; returns the pickled object after the last opcode, else `None`.
    fn step(&mut self) -> Result<Option<Value<'a>>, Fault> {
        let [op] = self.array()?;
        match op {
            // PROTO, FRAME: no effect; the length of a frame is not trusted.
            0x80 => {
                let [version] = self.array()?;
                if version > 5 {
                    return malformed!("pickle: protocol {version} is unknown");
                }
            }
            0x95 => {
                self.array::<8>()?;
            }
            b'.' => {
                let value = self.pop()?;
                return Ok(Some(value));
            }
            b'(' => self.marks.push(self.stack.len()),
            b'0' => {
                self.pop()?;
            }
            b'1' => {
                self.pop_mark()?;
            }
            b'2' => {
                let top = self.peek()?;
                self.stack.push(top);
            }
            b'N' => self.stack.push(Value::None),
            0x88 => self.stack.push(Value::Bool(true)),
            0x89 => self.stack.push(Value::Bool(false)),
            b'J' => {
                let v = i32::from_le_bytes(self.array()?);
                self.stack.push(Value::Int(v.into()));
            }
            b'K' => {
                let [v] = self.array()?;
                self.stack.push(Value::Int(v.into()));
            }
            b'M' => {
                let v = u16::from_le_bytes(self.array()?);
                self.stack.push(Value::Int(v.into()));
            }
            0x8a => {
                let [len] = self.array()?;
                self.long(len as usize)?;
            }
            0x8b => {
                let len = u32::from_le_bytes(self.array()?);
                self.long(len as usize)?;
            }
            b'G' => {
                self.array::<8>()?;
                self.stack.push(Value::Float);
            }
            // Strings: today's opcodes, then those of Python 2.
            0x8c | b'U' => {
                let [len] = self.array()?;
                self.string(len.into())?;
            }
            b'X' | b'T' => {
                let len = u32::from_le_bytes(self.array()?);
                self.string(len.into())?;
            }
            0x8d => {
                let len = u64::from_le_bytes(self.array()?);
                self.string(len)?;
            }
            b'C' => {
                let [len] = self.array()?;
                self.take(len.into())?;
                self.stack.push(Value::Bytes);
            }
            b'B' => {
                let len = u32::from_le_bytes(self.array()?);
                self.take(len.into())?;
                self.stack.push(Value::Bytes);
            }
            0x8e | 0x96 => {
                let len = u64::from_le_bytes(self.array()?);
                self.take(len)?;
                self.stack.push(Value::Bytes);
            }
            b')' => self.tuple(self.stack.len())?,
            0x85..=0x87 => {
                let count = usize::from(op - 0x84);
                let floor = self.floor();
                match self.stack.len().checked_sub(count) {
                    Some(start) if start >= floor => self.tuple(start)?,
                    _ => return malformed!("pickle: the stack is too short"),
                }
            }
            b't' => {
                let start = self.pop_mark_start()?;
                self.tuple(start)?;
            }
            b']' => {
                self.heap.lists.push(Vec::new());
                let id = self.heap.lists.len() as u32 - 1;
                self.stack.push(Value::List(id));
            }
            // Sets are represented as lists of their items, which are never read.
            0x8f => {
                self.heap.lists.push(Vec::new());
                let id = self.heap.lists.len() as u32 - 1;
                self.stack.push(Value::List(id));
            }
            0x90 => {
                let items = self.pop_mark()?;
                let set = self.peek()?;
                self.append(set, &items)?;
            }
            0x91 => {
                let start = self.pop_mark_start()?;
                self.tuple(start)?;
            }
            b'}' => {
                let dict = self.heap.new_dict(Vec::new());
                self.stack.push(dict);
            }
            b'a' => {
                let item = self.pop()?;
                let list = self.peek()?;
                self.append(list, &[item])?;
            }
            b'e' => {
                let items = self.pop_mark()?;
                let list = self.peek()?;
                self.append(list, &items)?;
            }
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                let dict = self.peek()?;
                self.set(dict, &[key, value])?;
            }
            b'u' => {
                let items = self.pop_mark()?;
                let dict = self.peek()?;
                self.set(dict, &items)?;
            }
            b'q' => {
                let [id] = self.array()?;
                self.remember(id.into())?;
            }
            b'r' => {
                let id = u32::from_le_bytes(self.array()?);
                self.remember(id)?;
            }
            // MEMOIZE uses the number of memo entries as the index.
            0x94 => self.remember(self.memo.len() as u32)?,
            b'h' => {
                let [id] = self.array()?;
                self.recall(id.into())?;
            }
            b'j' => {
                let id = u32::from_le_bytes(self.array()?);
                self.recall(id)?;
            }
            // Opcodes that instantiate a class. Unknown classes become placeholders. Supported
            // classes are an error, because state dicts never instantiate them in this way.
            0x81 | 0x92 => {
                // Pops the arguments; the second opcode also has keyword arguments.
                self.pop()?;
                if op == 0x92 {
                    self.pop()?;
                }
                let class = self.pop()?;
                self.object(class)?;
            }
            b'o' => match self.pop_mark()?[..] {
                [class, ..] => self.object(class)?,
                [] => return malformed!("pickle: an object without a class"),
            },
            b'i' => {
                let module = self.line()?;
                let name = self.line()?;
                self.pop_mark()?;
                self.global(module, name)?;
                let class = self.pop()?;
                self.object(class)?;
            }
            b'c' => {
                let module = self.line()?;
                let name = self.line()?;
                self.global(module, name)?;
            }
            0x93 => match (self.pop()?, self.pop()?) {
                (Value::Str(name), Value::Str(module)) => self.global(module, name)?,
                _ => return malformed!("pickle: a global without a name"),
            },
            b'R' => {
                let args = self.pop()?;
                let function = self.pop()?;
                let value = self.heap.construct(function, args)?;
                self.stack.push(value);
            }
            b'Q' => {
                let id = self.pop()?;
                let storage = self.heap.persistent(id)?;
                self.stack.push(storage);
            }
            // BUILD sets attributes: a state dict's `_metadata` (module versions), unused here.
            b'b' => {
                self.pop()?;
                let object = self.peek()?;
                if !matches!(object, Value::Dict(_) | Value::Foreign(_)) {
                    return malformed!("pickle: attributes are set on {}", object.kind());
                }
            }
            _ => return malformed!("pickle: opcode 0x{op:02x} is not used by state dicts"),
        }
        Ok(None)
    }

    fn take(&mut self, len: u64) -> Result<&'a [u8], Fault> {
        let taken = usize::try_from(len)
            .ok()
            .and_then(|len| self.bytes.get(self.at..self.at.checked_add(len)?));
        match taken {
            Some(taken) => {
                self.at += taken.len();
                Ok(taken)
            }
            None => Err(Fault::CutOff(self.at)),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N as u64)?);
        Ok(out)
    }

    fn line(&mut self) -> Result<&'a str, Fault> {
        let rest = &self.bytes[self.at..];
        // Names are short. Without this limit, a missing line end would make every opcode scan the whole file.
        let limit = rest.len().min(1024);
        let Some(len) = rest[..limit].iter().position(|&b| b == b'\n') else {
            return if limit == rest.len() {
                Err(Fault::CutOff(self.at))
            } else {
                malformed!("pickle: the name of a global does not end")
            };
        };
        let text = self.take(len as u64)?;
        self.at += 1;
        utf8(text)
    }

    fn string(&mut self, len: u64) -> Result<(), Fault> {
        let text = utf8(self.take(len)?)?;
        self.stack.push(Value::Str(text));
        Ok(())
    }

    fn long(&mut self, len: usize) -> Result<(), Fault> {
        let bytes = self.take(len as u64)?;
        self.stack.push(if len > 8 {
            Value::Long(bytes)
        } else {
            let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
            let mut wide = [if negative { 0xFF } else { 0 }; 8];
            wide[..len].copy_from_slice(bytes);
            Value::Int(i64::from_le_bytes(wide))
        });
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) -> Result<(), Fault> {
        let value = match Global::find(module, name) {
            Some(global) => Value::Global(global),
            None => {
                self.heap.foreign.push(format!("{module}.{name}"));
                Value::Foreign(self.heap.foreign.len() as u32 - 1)
            }
        };
        self.stack.push(value);
        Ok(())
    }

    /// Handles an opcode that creates an object. Nothing is created: the placeholder of the object's class is pushed
    /// instead.
    fn object(&mut self, class: Value<'a>) -> Result<(), Fault> {
        if !matches!(class, Value::Foreign(_)) {
            return malformed!(
                "pickle: an object is created from {}, which is not supported",
                class.kind()
            );
        }
        self.stack.push(class);
        Ok(())
    }

    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn peek(&self) -> Result<Value<'a>, Fault> {
        match self.stack.last() {
            Some(&top) if self.stack.len() > self.floor() => Ok(top),
            _ => malformed!("pickle: the stack is empty"),
        }
    }

    fn pop(&mut self) -> Result<Value<'a>, Fault> {
        let top = self.peek()?;
        self.stack.pop();
        Ok(top)
    }

    fn pop_mark_start(&mut self) -> Result<usize, Fault> {
        match self.marks.pop() {
            Some(start) => Ok(start),
            None => malformed!("pickle: an operation needs a mark, but the stack has none"),
        }
    }

    fn pop_mark(&mut self) -> Result<Vec<Value<'a>>, Fault> {
        let start = self.pop_mark_start()?;
        Ok(self.stack.split_off(start))
    }

    /// Replaces the values on the stack from `start` on with one tuple of these values.
    fn tuple(&mut self, start: usize) -> Result<(), Fault> {
        let first = self.heap.tuples.len() as u32;
        self.heap.tuples.extend(self.stack.drain(start..));
        let end = self.heap.tuples.len() as u32;
        self.stack.push(Value::Tuple(first, end));
        Ok(())
    }

    fn append(&mut self, list: Value<'a>, items: &[Value<'a>]) -> Result<(), Fault> {
        if let Value::Foreign(_) = list {
            return Ok(());
        }
        let Value::List(id) = list else {
            return malformed!("pickle: items are appended to {}", list.kind());
        };
        self.heap.lists[id as usize].extend(items);
        Ok(())
    }

    fn set(&mut self, dict: Value<'a>, items: &[Value<'a>]) -> Result<(), Fault> {
        if let Value::Foreign(_) = dict {
            return Ok(());
        }
        let (Value::Dict(id), (pairs, [])) = (dict, items.as_chunks::<2>()) else {
            return malformed!("pickle: items are set on {}", dict.kind());
        };
        self.heap.dicts[id as usize].extend(pairs.iter().map(|&[k, v]| (k, v)));
        Ok(())
    }

    fn remember(&mut self, id: u32) -> Result<(), Fault> {
        let top = self.peek()?;
        self.memo.insert(id, top);
        Ok(())
    }

    fn recall(&mut self, id: u32) -> Result<(), Fault> {
        let Some(&value) = self.memo.get(&id) else {
            return malformed!("pickle: memo {id} is empty");
        };
        self.stack.push(value);
        Ok(())
    }
}

fn utf8(bytes: &[u8]) -> Result<&str, Fault> {
    std::str::from_utf8(bytes).map_err(|_| Fault::Malformed("pickle: a string is not UTF-8".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(bytes: &[u8]) -> Result<String, Fault> {
        let mut heap = Heap::default();
        let (value, used) = load(bytes, &mut heap)?;
        assert!(used <= bytes.len());
        Ok(format!("{value:?}"))
    }

    #[test]
    fn integers_of_every_width() {
        assert_eq!(run(b"\x80\x02K\xff.").unwrap(), "Int(255)");
        assert_eq!(run(b"M\x01\x02.").unwrap(), "Int(513)");
        assert_eq!(run(b"J\xfe\xff\xff\xff.").unwrap(), "Int(-2)");
        assert_eq!(run(b"\x8a\x01\xff.").unwrap(), "Int(-1)");
        assert_eq!(run(b"\x8a\x00.").unwrap(), "Int(0)");
        assert_eq!(run(b"\x8a\x03\x00\x00\x01.").unwrap(), "Int(65536)");
        assert!(run(b"\x8a\x09012345678.").unwrap().starts_with("Long"));
    }

    #[test]
    fn what_is_not_known_is_a_name_and_nothing_is_called() {
        for (bytes, name) in [
            (
                &b"\x80\x02cposix\nsystem\nX\x04\x00\x00\x00true\x85R."[..],
                "posix.system",
            ),
            (
                b"\x80\x04\x8c\x08builtins\x94\x8c\x04eval\x94\x93\x8c\x011\x85R.",
                "builtins.eval",
            ),
            (b"\x80\x02ctorch\nEvilStorage\n.", "torch.EvilStorage"),
            // argparse.Namespace(lr=1) of protocol 2, and an object of protocol 0.
            (
                b"\x80\x02cargparse\nNamespace\n)\x81}X\x02\x00\x00\x00lrK\x01sb.",
                "argparse.Namespace",
            ),
            (b"(imine\nThing\n}b.", "mine.Thing"),
            (b"(cmine\nThing\nK\x01o.", "mine.Thing"),
            (b"cmine\nThing\n)}\x92.", "mine.Thing"),
            // Items of a subclass of list and of dict.
            (b"cmine\nThing\n)R(K\x01K\x02e(K\x01K\x02u.", "mine.Thing"),
        ] {
            let mut heap = Heap::default();
            let (value, _) = load(bytes, &mut heap).unwrap();
            assert_eq!(
                (value, &heap.foreign[..]),
                (Value::Foreign(0), &[name.to_owned()][..])
            );
        }
        assert_eq!(
            run(b"\x8f(K\x01\x90(K\x02\x91\x86.").unwrap(),
            "Tuple(1, 3)"
        );
    }

    #[test]
    fn broken_streams_are_errors() {
        for bytes in [
            &b""[..],
            b"K",
            b".",
            b"(.",
            b"K\x01(0.",
            b"K\x01(\x85.",
            b"t.",
            b"h\x05.",
            b"K\x01q\x00",
            b"}K\x01K\x02K\x03K\x04(K\x01u.",
            b"]K\x01K\x02s.",
            b"}K\x01a.",
            b"K\x01K\x02R.",
            b"K\x01Q.",
            b"K\x01}b.",
            b"X\xff\xff\xff\xffabc.",
            b"\x8d\xff\xff\xff\xff\xff\xff\xff\xffabc.",
            b"U\x01\xff.",
            b"\x80\x09N.",
            b"cnoend",
            b"ctorch._utils\n_rebuild_tensor_v2\n)R.",
            b"i\n.",
            b"K\x01)\x81.",
            b"(o.",
        ] {
            assert!(run(bytes).is_err(), "{bytes:?}");
        }
    }

    #[test]
    fn deep_nesting_and_cycles_neither_overflow_nor_hang() {
        let mut nested = vec![b')'];
        nested.resize(1 << 18, 0x85);
        nested.push(b'.');
        assert!(run(&nested).is_ok());
        // A list that contains itself.
        assert!(run(b"]q\x00h\x00a.").is_ok());
        let endless = vec![b'N'; 1 << 20];
        assert!(run(&endless).is_err());
    }
}
