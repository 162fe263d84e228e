//! Voxel values in the type the file had.

use std::str::FromStr;

use rayon::prelude::*;

/// A voxel type.
pub(crate) trait Scalar: bytemuck::Pod + FromStr {
    /// The same bytes in the opposite order.
    fn swapped(self) -> Self;
}

/// A source of values of any scalar type: a reader of bytes or a parser of numbers.
pub(crate) trait Decode {
    /// The error of the source.
    type Error;

    /// All values.
    fn decode<T: Scalar>(&mut self) -> Result<Vec<T>, Self::Error>;
}

/// Range of the finite values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// Least finite value; 0 without finite values.
    pub low: f64,
    /// Greatest finite value; 0 without finite values.
    pub high: f64,
    /// Number of values that are NaN or infinite.
    pub non_finite: usize,
}

fn range_of<T: Copy + Sync>(values: &[T], to_f64: impl Fn(T) -> f64 + Sync) -> ValueRange {
    let empty = (f64::INFINITY, f64::NEG_INFINITY, 0_usize);
    let (low, high, non_finite) = values
        .par_chunks(1 << 16)
        .map(|chunk| {
            chunk.iter().fold(empty, |(low, high, bad), &x| {
                let x = to_f64(x);
                if x.is_finite() { (low.min(x), high.max(x), bad) } else { (low, high, bad + 1) }
            })
        })
        .reduce(|| empty, |a, b| (a.0.min(b.0), a.1.max(b.1), a.2 + b.2));
    if low <= high { ValueRange { low, high, non_finite } } else { ValueRange { low: 0.0, high: 0.0, non_finite } }
}

/// Defines the scalar types once: the type tags, the typed vectors and their shared methods.
macro_rules! scalar_types {
    ($($variant:ident, $ty:ty, $name:literal, $vtk:literal, [$($synonym:literal),*];)*) => {
        /// The type of a volume's values.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum ScalarType {
            $(#[doc = concat!("`", $name, "`.")] $variant,)*
        }

        impl ScalarType {
            /// Every type, in order of declaration.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// The name used in raw file names and messages.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// The name VTK's XML files use.
            #[must_use]
            pub fn vtk_name(self) -> &'static str {
                match self { $(Self::$variant => $vtk,)* }
            }

            /// Bytes of one value.
            #[must_use]
            pub fn bytes(self) -> usize {
                match self { $(Self::$variant => size_of::<$ty>(),)* }
            }

            /// The type of a name; synonyms of the NRRD specification count too.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
                match name { $($name $(| $synonym)* => Some(Self::$variant),)* _ => None }
            }
        }

        /// The values of all voxels, in the type the file had, x fastest.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Scalars {
            $(#[doc = concat!("`", $name, "` values.")] $variant(Vec<$ty>),)*
        }

        impl Scalars {
            /// Type of the values.
            #[must_use]
            pub fn scalar_type(&self) -> ScalarType {
                match self { $(Self::$variant(_) => ScalarType::$variant,)* }
            }

            /// Number of values.
            #[must_use]
            pub fn len(&self) -> usize {
                match self { $(Self::$variant(v) => v.len(),)* }
            }

            /// Value `i` as f64, exact up to 53 bits; `None` past the end.
            #[must_use]
            pub fn get(&self, i: usize) -> Option<f64> {
                match self { $(Self::$variant(v) => v.get(i).map(|&x| x as f64),)* }
            }

            /// The values as little-endian bytes, in pieces of at most `piece` values.
            pub(crate) fn for_each_piece<E>(
                &self,
                piece: usize,
                mut f: impl FnMut(&[u8]) -> Result<(), E>,
            ) -> Result<(), E> {
                let mut bytes = Vec::new();
                match self { $(Self::$variant(v) => for values in v.chunks(piece.max(1)) {
                    bytes.clear();
                    for x in values {
                        bytes.extend_from_slice(&x.to_le_bytes());
                    }
                    f(&bytes)?;
                })* }
                Ok(())
            }

            /// Least and greatest finite value and the number of values that are not finite.
            #[must_use]
            pub fn range(&self) -> ValueRange {
                match self { $(Self::$variant(v) => range_of(v, |x| x as f64),)* }
            }

            /// The values at these places; those past the end are left out.
            pub(crate) fn picked(&self, places: &[usize]) -> Self {
                match self { $(Self::$variant(v) => {
                    Self::$variant(places.iter().filter_map(|&place| v.get(place).copied()).collect())
                },)* }
            }

            /// These values and then others of the same type; `None` for another type.
            pub(crate) fn joined(self, other: Self) -> Option<Self> {
                match (self, other) {
                    $((Self::$variant(mut v), Self::$variant(other)) => {
                        v.extend(other);
                        Some(Self::$variant(v))
                    })*
                    _ => None,
                }
            }

            /// The values as indices: whole numbers from 0 on.
            ///
            /// # Errors
            /// The first one that is not: its place and value.
            pub(crate) fn indices(&self) -> Result<Vec<u64>, (usize, f64)> {
                let most = (1_u64 << 53) as f64;
                match self { $(Self::$variant(v) => v.iter().enumerate().map(|(i, &x)| {
                    let value = x as f64;
                    if (0.0..=most).contains(&value) && value.fract() == 0.0 { Ok(value as u64) } else { Err((i, value)) }
                }).collect(),)* }
            }

            /// The values with a true flag, in their order.
            pub(crate) fn filtered(&self, keeps: &[bool]) -> Self {
                match self { $(Self::$variant(v) => {
                    Self::$variant(v.iter().zip(keeps).filter(|(_, keeps)| **keeps).map(|(x, _)| *x).collect())
                },)* }
            }

            /// Every value times `slope` plus `intercept`, computed in f64. The result has type [`ScalarType::scaled`].
            pub(crate) fn scaled(&self, slope: f64, intercept: f64) -> Self {
                let scale = |x: f64| x * slope + intercept;
                match self { $(Self::$variant(v) => match ScalarType::$variant.scaled() {
                    ScalarType::F32 => Self::F32(v.par_iter().map(|&x| scale(x as f64) as f32).collect()),
                    _ => Self::F64(v.par_iter().map(|&x| scale(x as f64)).collect()),
                },)* }
            }

            /// Every value less `offset`, subtracted in f64 and then narrowed to f32.
            pub(crate) fn to_f32(&self, offset: f64) -> Vec<f32> {
                match self { $(Self::$variant(v) => v.par_iter().map(|&x| (x as f64 - offset) as f32).collect(),)* }
            }
        }

        $(impl From<Vec<$ty>> for Scalars {
            fn from(values: Vec<$ty>) -> Self { Self::$variant(values) }
        })*

        impl Scalars {
            /// Values of type `kind` from a decoder.
            pub(crate) fn decode<D: Decode>(kind: ScalarType, mut decoder: D) -> Result<Self, D::Error> {
                match kind { $(ScalarType::$variant => decoder.decode::<$ty>().map(Self::$variant),)* }
            }
        }

        $(impl Scalar for $ty {
            fn swapped(self) -> Self {
                let mut bytes = self.to_ne_bytes();
                bytes.reverse();
                Self::from_ne_bytes(bytes)
            }
        })*
    };
}

scalar_types! {
    U8, u8, "uint8", "UInt8", ["uint8_t", "uchar", "unsigned char"];
    I8, i8, "int8", "Int8", ["int8_t", "signed char"];
    U16, u16, "uint16", "UInt16", ["uint16_t", "ushort", "unsigned short", "unsigned short int"];
    I16, i16, "int16", "Int16", ["int16_t", "short", "short int", "signed short", "signed short int"];
    U32, u32, "uint32", "UInt32", ["uint32_t", "uint", "unsigned int"];
    I32, i32, "int32", "Int32", ["int32_t", "int", "signed int"];
    U64, u64, "uint64", "UInt64", ["uint64_t", "ulonglong", "unsigned long long", "unsigned long long int"];
    I64, i64, "int64", "Int64", ["int64_t", "longlong", "long long", "long long int", "signed long long"];
    F32, f32, "float32", "Float32", ["float"];
    F64, f64, "float64", "Float64", ["double"];
}

impl ScalarType {
    /// The type of a name in VTK's XML files.
    #[must_use]
    pub fn from_vtk_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|t| t.vtk_name() == name)
    }

    /// Whether every value of the type is exact in f32.
    #[must_use]
    pub fn fits_f32(self) -> bool {
        matches!(self, Self::U8 | Self::I8 | Self::U16 | Self::I16 | Self::F32)
    }
}

impl ScalarType {
    /// The type of scaled values: float32 if it holds the stored values exactly, else float64.
    pub(crate) fn scaled(self) -> Self {
        if self.fits_f32() { Self::F32 } else { Self::F64 }
    }
}

impl Scalars {
    /// The values in f32, what was subtracted from them, and their range. For types that f32 cannot hold exactly, that is the least
    /// value. The subtraction is in f64, so small differences on a large offset survive.
    pub(crate) fn narrowed(&self) -> (Vec<f32>, f64, ValueRange) {
        let range = self.range();
        let offset = if self.scalar_type().fits_f32() { 0.0 } else { range.low };
        (self.to_f32(offset), offset, range)
    }

    /// Whether there is no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_sizes_agree() {
        for &t in ScalarType::ALL {
            assert_eq!(ScalarType::from_name(t.name()), Some(t));
            assert_eq!(ScalarType::from_vtk_name(t.vtk_name()), Some(t));
            let digits: String = t.name().chars().filter(char::is_ascii_digit).collect();
            assert_eq!(digits.parse::<usize>().unwrap(), 8 * t.bytes(), "{}", t.name());
        }
        assert_eq!(ScalarType::from_name("unsigned char"), Some(ScalarType::U8));
        assert_eq!(ScalarType::from_name("block"), None);
    }

    #[test]
    fn the_range_skips_and_counts_values_that_are_not_finite() {
        let s = Scalars::from(vec![f32::NAN, 2.0, -1.0, f32::INFINITY]);
        assert_eq!(s.range(), ValueRange { low: -1.0, high: 2.0, non_finite: 2 });
        let none = Scalars::from(vec![f64::NAN]);
        assert_eq!(none.range(), ValueRange { low: 0.0, high: 0.0, non_finite: 1 });
    }
}
