//! Writing `binary_little_endian` files.

use std::borrow::Cow;
use std::io::{self, Write};

use rayon::prelude::*;

use super::Scalar;
use sg_scene::model::{ExtraColumn, ExtraValues};

/// Rows that are packed before they are written: a few megabytes at 248 bytes a row.
const BLOCK: usize = 1 << 14;
/// Rows that one task packs.
const TASK: usize = 1 << 10;

pub(crate) struct OutElement<'a> {
    pub(crate) name: &'static str,
    pub(crate) rows: usize,
    pub(crate) properties: Vec<OutProperty<'a>>,
}

/// A property whose value in row `i` is `values[i·width + offset]`.
pub(crate) struct OutProperty<'a> {
    pub(crate) name: Cow<'a, str>,
    pub(crate) values: OutValues<'a>,
    pub(crate) width: usize,
    pub(crate) offset: usize,
}

#[derive(Clone, Copy)]
pub(crate) enum OutValues<'a> {
    I8(&'a [i8]),
    U8(&'a [u8]),
    I16(&'a [i16]),
    U16(&'a [u16]),
    I32(&'a [i32]),
    U32(&'a [u32]),
    F32(&'a [f32]),
    F64(&'a [f64]),
}

impl<'a> OutProperty<'a> {
    pub(crate) fn new(name: impl Into<Cow<'a, str>>, values: OutValues<'a>, width: usize, offset: usize) -> Self {
        Self { name: name.into(), values, width, offset }
    }

    /// `names` in order, the components of one `f32` array of rows of that width.
    pub(crate) fn vector<const K: usize>(names: [&'static str; K], values: &'a [f32]) -> impl Iterator<Item = Self> {
        names.into_iter().enumerate().map(move |(at, name)| Self::new(name, OutValues::F32(values), K, at))
    }

    pub(crate) fn extra(column: &'a ExtraColumn) -> Self {
        let values = match &column.values {
            ExtraValues::I8(v) => OutValues::I8(v),
            ExtraValues::U8(v) => OutValues::U8(v),
            ExtraValues::I16(v) => OutValues::I16(v),
            ExtraValues::U16(v) => OutValues::U16(v),
            ExtraValues::I32(v) => OutValues::I32(v),
            ExtraValues::U32(v) => OutValues::U32(v),
            ExtraValues::F32(v) => OutValues::F32(v),
            ExtraValues::F64(v) => OutValues::F64(v),
        };
        Self::new(column.name.as_str(), values, 1, 0)
    }
}

impl OutValues<'_> {
    fn scalar(&self) -> Scalar {
        match self {
            Self::I8(_) => Scalar::I8,
            Self::U8(_) => Scalar::U8,
            Self::I16(_) => Scalar::I16,
            Self::U16(_) => Scalar::U16,
            Self::I32(_) => Scalar::I32,
            Self::U32(_) => Scalar::U32,
            Self::F32(_) => Scalar::F32,
            Self::F64(_) => Scalar::F64,
        }
    }
}

/// Writes a header and the rows of all elements. Comments come last in the header: some viewers of 3DGS files expect an element
/// in its third line.
pub(crate) fn write(out: &mut impl Write, comments: &[String], elements: &[OutElement<'_>]) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    for element in elements {
        writeln!(out, "element {} {}", element.name, element.rows)?;
        for property in &element.properties {
            writeln!(out, "property {} {}", property.values.scalar().name(), property.name)?;
        }
    }
    for comment in comments {
        writeln!(out, "comment {comment}")?;
    }
    writeln!(out, "end_header")?;
    elements.iter().try_for_each(|e| write_rows(out, e))
}

fn write_rows(out: &mut impl Write, element: &OutElement<'_>) -> io::Result<()> {
    let stride: usize = element.properties.iter().map(|p| p.values.scalar().size()).sum();
    if stride == 0 {
        return Ok(());
    }
    let mut block = vec![0; BLOCK.min(element.rows) * stride];
    let mut first = 0;
    while first < element.rows {
        let rows = BLOCK.min(element.rows - first);
        block.truncate(rows * stride);
        block.par_chunks_mut(TASK * stride).enumerate().for_each(|(k, chunk)| {
            let mut at = 0;
            for property in &element.properties {
                pack(property, first + k * TASK, chunk, stride, at);
                at += property.values.scalar().size();
            }
        });
        out.write_all(&block)?;
        first += rows;
    }
    Ok(())
}

/// Packs one property of the rows from `first` on into `chunk`, at byte `at` of each row.
fn pack(property: &OutProperty<'_>, first: usize, chunk: &mut [u8], stride: usize, at: usize) {
    fn put<T: Copy, const N: usize>(
        values: &[T],
        (width, from): (usize, usize),
        rows: std::slice::ChunksExactMut<'_, u8>,
        at: usize,
        bytes: impl Fn(T) -> [u8; N],
    ) {
        let column = values.get(from..).unwrap_or_default().iter().step_by(width.max(1));
        for (row, &value) in rows.zip(column) {
            if let Some(to) = row.get_mut(at..at + N) {
                to.copy_from_slice(&bytes(value));
            }
        }
    }
    let rows = chunk.chunks_exact_mut(stride);
    let place = (property.width, first * property.width + property.offset);
    match property.values {
        OutValues::I8(v) => put(v, place, rows, at, i8::to_le_bytes),
        OutValues::U8(v) => put(v, place, rows, at, u8::to_le_bytes),
        OutValues::I16(v) => put(v, place, rows, at, i16::to_le_bytes),
        OutValues::U16(v) => put(v, place, rows, at, u16::to_le_bytes),
        OutValues::I32(v) => put(v, place, rows, at, i32::to_le_bytes),
        OutValues::U32(v) => put(v, place, rows, at, u32::to_le_bytes),
        OutValues::F32(v) => put(v, place, rows, at, f32::to_le_bytes),
        OutValues::F64(v) => put(v, place, rows, at, f64::to_le_bytes),
    }
}
