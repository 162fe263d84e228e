//! The rows of one element, read column by column.

use rayon::prelude::*;

use super::Scalar;
use crate::splat::problem::Problem;
use sg_scene::model::{ExtraColumn, ExtraValues};

/// Rows that one task takes at least: below, the hand-over costs more than the work.
const MIN_ROWS: usize = 4096;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Column {
    pub(crate) name: String,
    pub(crate) scalar: Scalar,
    /// Bytes from the start of a row.
    pub(crate) offset: usize,
}

/// Packed little-endian rows.
#[derive(Debug, Clone)]
pub(crate) struct Table<'a> {
    pub(crate) name: String,
    pub(crate) rows: usize,
    pub(crate) columns: Vec<Column>,
    stride: usize,
    data: &'a [u8],
}

impl<'a> Table<'a> {
    pub(crate) fn new(name: &str, rows: usize, stride: usize, columns: &[Column], data: &'a [u8]) -> Self {
        Self { name: name.to_owned(), rows, columns: columns.to_vec(), stride: stride.max(1), data }
    }

    pub(crate) fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }

    /// Refuses the table if a column is missing, naming all that are.
    pub(crate) fn require(&self, names: &[&str], remedy: &str) -> Result<(), Problem> {
        let missing: Vec<_> = names.iter().filter(|n| self.column(n).is_none()).map(|n| format!("`{n}`")).collect();
        if missing.is_empty() {
            return Ok(());
        }
        Err(Problem::new(format!("element {}", self.name), format!("no property {}", missing.join(", ")), remedy))
    }

    /// `K` real columns, row by row. A `double` is narrowed; an integer is refused, because its scale is unknown.
    pub(crate) fn floats<const K: usize, T: Send>(
        &self,
        names: [&str; K],
        map: impl Fn([f32; K]) -> T + Sync,
    ) -> Result<Vec<T>, Problem> {
        let columns = self.pick(names)?;
        if let Some(c) = columns.iter().find(|c| !matches!(c.scalar, Scalar::F32 | Scalar::F64)) {
            return Err(self.wrong_type(c, "float"));
        }
        if columns.iter().all(|c| c.scalar == Scalar::F32) {
            let offsets = columns.map(|c| c.offset);
            return Ok(self.map_rows(|row| map(offsets.map(|at| f32_at(row, at)))));
        }
        let places = columns.map(|c| (c.offset, c.scalar));
        Ok(self.map_rows(|row| {
            map(places.map(|(at, scalar)| {
                if scalar == Scalar::F32 { f32_at(row, at) } else { f64::from_le_bytes(bytes_at(row, at)) as f32 }
            }))
        }))
    }

    /// `K` columns of 16-bit patterns, row by row.
    pub(crate) fn bits16<const K: usize, T: Send>(
        &self,
        names: [&str; K],
        map: impl Fn([u16; K]) -> T + Sync,
    ) -> Result<Vec<T>, Problem> {
        let columns = self.typed(names, &[Scalar::I16, Scalar::U16], "short")?;
        Ok(self.map_rows(|row| map(columns.map(|at| u16::from_le_bytes(bytes_at(row, at))))))
    }

    /// `K` columns of `uint`, row by row.
    pub(crate) fn words<const K: usize, T: Send>(
        &self,
        names: [&str; K],
        map: impl Fn([u32; K]) -> T + Sync,
    ) -> Result<Vec<T>, Problem> {
        let columns = self.typed(names, &[Scalar::U32], "uint")?;
        Ok(self.map_rows(|row| map(columns.map(|at| u32::from_le_bytes(bytes_at(row, at))))))
    }

    /// `K` columns of `uchar`, row by row.
    pub(crate) fn bytes<const K: usize, T: Send>(
        &self,
        names: [&str; K],
        map: impl Fn([u8; K]) -> T + Sync,
    ) -> Result<Vec<T>, Problem> {
        let columns = self.typed(names, &[Scalar::U8], "uchar")?;
        Ok(self.map_rows(|row| map(columns.map(|at| row.get(at).copied().unwrap_or_default()))))
    }

    /// Runs over rows and the equally many chunks of `out`, `width` values each.
    pub(crate) fn fill<T: Send>(&self, out: &mut [T], width: usize, put: impl Fn(&[u8], &mut [T]) + Sync) {
        if width > 0 {
            let rows = self.data.par_chunks_exact(self.stride);
            out.par_chunks_exact_mut(width).zip(rows).with_min_len(MIN_ROWS).for_each(|(to, row)| put(row, to));
        }
    }

    /// All columns that are not among the known ones, in their own types.
    pub(crate) fn extra(&self, known: impl Fn(&str) -> bool) -> Vec<ExtraColumn> {
        let take = |c: &Column| ExtraColumn { name: c.name.clone(), values: self.values(c) };
        self.columns.iter().filter(|c| !known(&c.name)).map(take).collect()
    }

    fn values(&self, column: &Column) -> ExtraValues {
        let at = column.offset;
        match column.scalar {
            Scalar::I8 => ExtraValues::I8(self.map_rows(|r| i8::from_le_bytes(bytes_at(r, at)))),
            Scalar::U8 => ExtraValues::U8(self.map_rows(|r| u8::from_le_bytes(bytes_at(r, at)))),
            Scalar::I16 => ExtraValues::I16(self.map_rows(|r| i16::from_le_bytes(bytes_at(r, at)))),
            Scalar::U16 => ExtraValues::U16(self.map_rows(|r| u16::from_le_bytes(bytes_at(r, at)))),
            Scalar::I32 => ExtraValues::I32(self.map_rows(|r| i32::from_le_bytes(bytes_at(r, at)))),
            Scalar::U32 => ExtraValues::U32(self.map_rows(|r| u32::from_le_bytes(bytes_at(r, at)))),
            Scalar::F32 => ExtraValues::F32(self.map_rows(|r| f32_at(r, at))),
            Scalar::F64 => ExtraValues::F64(self.map_rows(|r| f64::from_le_bytes(bytes_at(r, at)))),
        }
    }

    fn map_rows<T: Send>(&self, map: impl Fn(&[u8]) -> T + Sync) -> Vec<T> {
        self.data.par_chunks_exact(self.stride).with_min_len(MIN_ROWS).map(&map).collect()
    }

    fn pick<const K: usize>(&self, names: [&str; K]) -> Result<[&Column; K], Problem> {
        self.require(&names, "this column is needed: write the file again with it")?;
        let found: Vec<_> = names.iter().filter_map(|n| self.column(n)).collect();
        found
            .try_into()
            .map_err(|_| Problem::new(format!("element {}", self.name), "a column is missing", "write it again"))
    }

    fn typed<const K: usize>(&self, names: [&str; K], types: &[Scalar], want: &str) -> Result<[usize; K], Problem> {
        let columns = self.pick(names)?;
        match columns.iter().find(|c| !types.contains(&c.scalar)) {
            Some(c) => Err(self.wrong_type(c, want)),
            None => Ok(columns.map(|c| c.offset)),
        }
    }

    fn wrong_type(&self, column: &Column, want: &str) -> Problem {
        Problem::new(
            format!("element {}, property {}", self.name, column.name),
            format!("its type is {}", column.scalar.name()),
            format!("it must be {want}"),
        )
    }
}

/// The value at a byte offset that lies within the row by construction of the columns.
#[inline]
pub(crate) fn f32_at(row: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes_at(row, at))
}

#[inline]
fn bytes_at<const N: usize>(row: &[u8], at: usize) -> [u8; N] {
    row.get(at..).and_then(|r| r.first_chunk()).copied().unwrap_or([0; N])
}
