//! The part of Python's pickle protocol that a saved tensor needs, read as data without calls.
//!
//! Values live in an arena and refer to each other by index. A hostile file can neither exhaust the stack nor multiply
//! shared values. Functions are remembered as names and calls as pairs of name and argument.

use crate::splat::problem::Problem;

/// Longest stream that is read; a palette with its optimiser takes about a thousand bytes.
pub(crate) const MAX_BYTES: usize = 1 << 20;

/// Index of a value in the arena.
pub(crate) type Id = usize;

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    Dict,
    /// `module name` of a class or function.
    Global(String),
    /// A persistent id: the storage of a tensor.
    Persistent(Id),
    /// A call of a function with a tuple of arguments.
    Call(Id, Id),
}

#[derive(Debug)]
pub(crate) struct Pickle {
    values: Vec<Value>,
    root: Id,
}

impl Pickle {
    pub(crate) fn root(&self) -> Id {
        self.root
    }

    pub(crate) fn get(&self, id: Id) -> &Value {
        self.values.get(id).unwrap_or(&Value::None)
    }

    /// Element `k` of a tuple or list.
    pub(crate) fn item(&self, id: Id, k: usize) -> Option<Id> {
        match self.get(id) {
            Value::Tuple(items) | Value::List(items) => items.get(k).copied(),
            _ => None,
        }
    }

    /// Reads one pickled value.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, Problem> {
        if bytes.len() > MAX_BYTES {
            let what = format!("the pickle takes {} bytes", bytes.len());
            return Err(Problem::new("data.pkl", what, format!("a palette takes less than {MAX_BYTES}")));
        }
        let mut machine = Machine { bytes, at: 0, values: vec![], stack: vec![], marks: vec![], memo: vec![] };
        loop {
            let at = machine.at;
            match machine.step() {
                Some(Step::Next) => {}
                Some(Step::Stop(root)) => return Ok(Self { values: machine.values, root }),
                Some(Step::Unknown(op)) => {
                    let what = format!("opcode {op:#04x} is none that a saved tensor needs");
                    return Err(Problem::new(format!("data.pkl, byte {at}"), what, "save it with torch.save"));
                }
                None => {
                    return Err(Problem::new(
                        format!("data.pkl, byte {at}"),
                        "the pickle is cut off or inconsistent",
                        "save it again",
                    ));
                }
            }
        }
    }
}

enum Step {
    Next,
    Stop(Id),
    Unknown(u8),
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    values: Vec<Value>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: Vec<Option<Id>>,
}

impl<'a> Machine<'a> {
    /// One opcode; nothing where the stream ends or the stack is too short.
    fn step(&mut self) -> Option<Step> {
        let [op] = self.take::<1>()?;
        match op {
            0x80 => {
                self.take::<1>()?; // PROTO
            }
            0x95 => {
                self.take::<8>()?; // FRAME
            }
            b'.' => return Some(Step::Stop(self.stack.pop()?)), // STOP
            b'(' => self.marks.push(self.stack.len()),          // MARK
            b'0' => {
                self.stack.pop()?; // POP
            }
            b'N' => self.push(Value::None),        // NONE
            0x88 => self.push(Value::Bool(true)),  // NEWTRUE
            0x89 => self.push(Value::Bool(false)), // NEWFALSE
            b'K' => {
                let [x] = self.take::<1>()?;
                self.push(Value::Int(i64::from(x))); // BININT1
            }
            b'M' => {
                let x = self.take::<2>()?;
                self.push(Value::Int(i64::from(u16::from_le_bytes(x)))); // BININT2
            }
            b'J' => {
                let x = self.take::<4>()?;
                self.push(Value::Int(i64::from(i32::from_le_bytes(x)))); // BININT
            }
            0x8a => {
                let [n] = self.take::<1>()?;
                let digits = self.slice(usize::from(n))?;
                self.push(Value::Int(long(digits)?)); // LONG1
            }
            b'G' => {
                let x = self.take::<8>()?;
                self.push(Value::Float(f64::from_be_bytes(x))); // BINFLOAT
            }
            b'X' => {
                let n = u32::from_le_bytes(self.take::<4>()?);
                self.text(n as usize)?; // BINUNICODE
            }
            0x8c => {
                let [n] = self.take::<1>()?;
                self.text(usize::from(n))?; // SHORT_BINUNICODE
            }
            b')' => self.push(Value::Tuple(vec![])), // EMPTY_TUPLE
            b']' => self.push(Value::List(vec![])),  // EMPTY_LIST
            b'}' => self.push(Value::Dict),          // EMPTY_DICT
            0x85..=0x87 => {
                let items = self.stack.len().checked_sub(usize::from(op - 0x84))?;
                let items = self.stack.split_off(items); // TUPLE1, TUPLE2, TUPLE3
                self.push(Value::Tuple(items));
            }
            b't' => {
                let items = self.since_mark()?;
                self.push(Value::Tuple(items)); // TUPLE
            }
            b'a' => {
                let item = self.stack.pop()?;
                self.append(&[item])?; // APPEND
            }
            b'e' => {
                let items = self.since_mark()?;
                self.append(&items)?; // APPENDS
            }
            b's' => {
                self.stack.pop()?;
                self.stack.pop()?; // SETITEM: no dictionary's content is needed
            }
            b'u' => {
                self.since_mark()?; // SETITEMS
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.push(Value::Global(format!("{module} {name}"))); // GLOBAL
            }
            0x93 => {
                let (name, module) = (self.stack.pop()?, self.stack.pop()?);
                let (Value::Text(name), Value::Text(module)) = (self.values.get(name)?, self.values.get(module)?)
                else {
                    return None;
                };
                let global = Value::Global(format!("{module} {name}"));
                self.push(global); // STACK_GLOBAL
            }
            b'R' | 0x81 => {
                let (arguments, function) = (self.stack.pop()?, self.stack.pop()?);
                self.push(Value::Call(function, arguments)); // REDUCE, NEWOBJ
            }
            b'b' => {
                self.stack.pop()?; // BUILD: an object's state is not needed
            }
            b'Q' => {
                let id = self.stack.pop()?;
                self.push(Value::Persistent(id)); // BINPERSID
            }
            b'q' => {
                let [k] = self.take::<1>()?;
                self.remember(usize::from(k))?; // BINPUT
            }
            b'r' => {
                let k = u32::from_le_bytes(self.take::<4>()?);
                self.remember(k as usize)?; // LONG_BINPUT
            }
            0x94 => self.remember(self.memo.len())?, // MEMOIZE
            b'h' => {
                let [k] = self.take::<1>()?;
                self.recall(usize::from(k))?; // BINGET
            }
            b'j' => {
                let k = u32::from_le_bytes(self.take::<4>()?);
                self.recall(k as usize)?; // LONG_BINGET
            }
            _ => return Some(Step::Unknown(op)),
        }
        Some(Step::Next)
    }

    fn push(&mut self, value: Value) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    fn slice(&mut self, n: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(n)?;
        let bytes = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.slice(N)?.first_chunk().copied()
    }

    fn line(&mut self) -> Option<&'a str> {
        let length = self.bytes.get(self.at..)?.iter().position(|&b| b == b'\n')?;
        let line = std::str::from_utf8(self.slice(length)?).ok()?;
        self.at += 1;
        Some(line)
    }

    fn text(&mut self, n: usize) -> Option<()> {
        let text = std::str::from_utf8(self.slice(n)?).ok()?.to_owned();
        self.push(Value::Text(text));
        Some(())
    }

    fn since_mark(&mut self) -> Option<Vec<Id>> {
        let mark = self.marks.pop()?;
        (mark <= self.stack.len()).then(|| self.stack.split_off(mark))
    }

    fn append(&mut self, items: &[Id]) -> Option<()> {
        match self.values.get_mut(*self.stack.last()?)? {
            Value::List(list) => list.extend_from_slice(items),
            _ => return None,
        }
        Some(())
    }

    fn remember(&mut self, k: usize) -> Option<()> {
        // Python numbers memo entries one by one; a gap beyond the stream's own length is hostile.
        if k > self.bytes.len() {
            return None;
        }
        if k >= self.memo.len() {
            self.memo.resize(k + 1, None);
        }
        *self.memo.get_mut(k)? = self.stack.last().copied();
        Some(())
    }

    fn recall(&mut self, k: usize) -> Option<()> {
        self.stack.push(self.memo.get(k).copied().flatten()?);
        Some(())
    }
}

/// A little-endian two's-complement integer of up to eight bytes.
fn long(digits: &[u8]) -> Option<i64> {
    let negative = digits.last().is_some_and(|d| d & 0x80 != 0);
    let mut word = [if negative { 0xff } else { 0 }; 8];
    word.get_mut(..digits.len())?.copy_from_slice(digits);
    Some(i64::from_le_bytes(word))
}
