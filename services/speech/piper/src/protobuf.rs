//! Fields of a protobuf message, one after the other, without copies.
//!
//! A hostile file can have millions of empty messages, each of which a generated type would give hundreds of bytes. Here a message
//! stays the bytes that it is.

/// A field's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Value<'a> {
    Varint(u64),
    Fixed32([u8; 4]),
    Fixed64,
    /// A string, a message or packed numbers.
    Bytes(&'a [u8]),
}

/// The message ends within a field, or has a field of no known kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Broken;

/// The fields of a message: number and value.
pub(crate) struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    pub(crate) fn of(message: &'a [u8]) -> Self {
        Self(message)
    }

    fn field(&mut self) -> Result<(u64, Value<'a>), Broken> {
        let key = varint(&mut self.0)?;
        let value = match key & 7 {
            0 => Value::Varint(varint(&mut self.0)?),
            1 => {
                self.take(8)?;
                Value::Fixed64
            }
            2 => {
                let length = usize::try_from(varint(&mut self.0)?).map_err(|_| Broken)?;
                Value::Bytes(self.take(length)?)
            }
            5 => Value::Fixed32(self.take(4)?.try_into().map_err(|_| Broken)?),
            _ => return Err(Broken),
        };
        Ok((key >> 3, value))
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], Broken> {
        let (taken, rest) = self.0.split_at_checked(length).ok_or(Broken)?;
        self.0 = rest;
        Ok(taken)
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u64, Value<'a>), Broken>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.0 = &[];
        }
        Some(field)
    }
}

/// A number of a variable number of bytes, at the start of `bytes`.
fn varint(bytes: &mut &[u8]) -> Result<u64, Broken> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first().ok_or(Broken)?;
        *bytes = rest;
        number |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(number);
        }
    }
    Err(Broken)
}

/// Appends the numbers of a repeated field, packed or single, but no more than `most` in all.
pub(crate) fn append_numbers(numbers: &mut Vec<i64>, value: Value, most: usize) -> Result<(), Broken> {
    let mut append = |number: u64| {
        numbers.push(number.cast_signed());
        if numbers.len() > most { Err(Broken) } else { Ok(()) }
    };
    match value {
        Value::Varint(number) => append(number),
        Value::Bytes(mut packed) => {
            while !packed.is_empty() {
                append(varint(&mut packed)?)?;
            }
            Ok(())
        }
        _ => Err(Broken),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_in_their_order() {
        // 1: 300; 2: "hi"; 3: a fixed number; 4: packed 1 and −1.
        let minus_one = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        let message =
            [&[0x08, 0xac, 0x02, 0x12, 2, b'h', b'i', 0x1d, 1, 2, 3, 4, 0x22, 11, 1][..], &minus_one].concat();
        let fields: Vec<_> = Fields::of(&message).collect::<Result<_, _>>().unwrap();
        assert_eq!(fields[..2], [(1, Value::Varint(300)), (2, Value::Bytes(b"hi"))]);
        assert_eq!(fields[2], (3, Value::Fixed32([1, 2, 3, 4])));
        let mut numbers = Vec::new();
        append_numbers(&mut numbers, fields[3].1, 2).unwrap();
        assert_eq!(numbers, [1, -1]);
        assert_eq!(append_numbers(&mut numbers, fields[3].1, 3), Err(Broken));
        for cut in [1, 2, 4, 6, 9] {
            assert!(Fields::of(&message[..cut]).any(|field| field.is_err()), "{cut}");
        }
    }
}
