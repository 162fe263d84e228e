//! Float pictures and the files they are written to.

use std::ffi::OsStr;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use npyz::WriterBuilder;
use sg_formats::staged_file::StagedFile;

/// A picture: RGB composited over the background, and A = 1 − transmittance. Rows from the top, no transfer function.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGBA of each pixel, `4·width·height` numbers.
    pub rgba: Vec<f32>,
}

/// A picture that could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// Another ending of the file's name than `.png` or `.npy`.
    #[error("{path}: a picture is written as .png or .npy; end the name in one of them")]
    Extension {
        /// The path given.
        path: PathBuf,
    },
    /// The system refused.
    #[error("{path}: {source}; nothing was written there")]
    Write {
        /// The path given.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// Kinds of picture files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// 8 bits a channel, round(255·clamp) unless dithered.
    Png,
    /// NumPy array, little-endian `float32 (height, width, 4)`.
    Npy,
}

impl ImageFormat {
    /// The kind that the ending of a file's name stands for.
    ///
    /// # Errors
    /// [`ImageError::Extension`] for any other ending than `.png` and `.npy`.
    pub fn of(path: &Path) -> Result<Self, ImageError> {
        match path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => Ok(Self::Png),
            Some("npy") => Ok(Self::Npy),
            _ => Err(ImageError::Extension { path: path.to_owned() }),
        }
    }
}

impl Image {
    /// A smaller picture: each pixel is the mean over its area. Sums are in f64.
    #[must_use]
    pub fn averaged(&self, width: u32, height: u32) -> Self {
        let spans = |from: u32, to: u32| {
            let step = f64::from(from) / f64::from(to.max(1));
            (0..to).map(move |k| (f64::from(k) * step, (f64::from(k) + 1.0) * step)).collect::<Vec<_>>()
        };
        // The pixels that a span meets, and the length of each within it.
        let parts = |(low, high): (f64, f64), most: u32| {
            (low.floor() as u32..(high.ceil() as u32).min(most))
                .map(move |k| (k as usize, high.min(f64::from(k) + 1.0) - low.max(f64::from(k))))
        };
        let columns = spans(self.width, width);
        let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
        for row in spans(self.height, height) {
            for column in &columns {
                let (mut sum, mut area) = ([0.0; 4], 0.0);
                for (y, tall) in parts(row, self.height) {
                    for (x, wide) in parts(*column, self.width) {
                        let at = 4 * (y * self.width as usize + x);
                        let pixel = self.rgba.get(at..at + 4).unwrap_or(&[0.0; 4]);
                        sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += tall * wide * f64::from(*value));
                        area += tall * wide;
                    }
                }
                rgba.extend(sum.map(|sum| (sum / area) as f32));
            }
        }
        Self { width, height, rgba }
    }

    /// The pixel at column `x` and row `y`; `None` outside.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> Option<[f32; 4]> {
        if x >= self.width {
            return None;
        }
        let at = 4 * (y as usize * self.width as usize + x as usize);
        self.rgba.get(at..at + 4)?.try_into().ok()
    }

    /// The pixels in row order.
    pub fn pixels(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.rgba.chunks_exact(4)
    }

    /// RGBA of each pixel, rows from the top.
    #[must_use]
    pub fn as_pixels(&self) -> &[[f32; 4]] {
        self.rgba.as_chunks().0
    }

    /// 8-bit RGB of the composited picture, round(255·clamp), row by row from the top.
    #[must_use]
    pub fn rgb8(&self) -> Vec<u8> {
        let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
        self.pixels().flat_map(|p| p.iter().take(3).map(|x| byte(*x)).collect::<Vec<_>>()).collect()
    }

    /// A PNG file of [`Self::rgb8`].
    ///
    /// # Errors
    /// When `writer` fails.
    pub fn write_png(&self, writer: impl Write) -> io::Result<()> {
        self.encode_png(writer, png::ColorType::Rgb, &self.rgb8())
    }

    /// A PNG file of 8-bit numbers of this picture's pixels.
    pub(crate) fn encode_png(&self, writer: impl Write, kind: png::ColorType, bytes: &[u8]) -> io::Result<()> {
        let mut encoder = png::Encoder::new(writer, self.width, self.height);
        encoder.set_color(kind);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer.write_image_data(bytes).map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)
    }

    /// A NumPy file of the float picture: little-endian `float32 (height, width, 4)`, C order.
    ///
    /// # Errors
    /// When `writer` fails.
    pub fn write_npy(&self, writer: impl Write) -> io::Result<()> {
        let dtype = npyz::DType::Plain("<f4".parse().map_err(io::Error::other)?);
        let mut npy = npyz::WriteOptions::<f32>::new()
            .dtype(dtype)
            .shape(&[self.height.into(), self.width.into(), 4])
            .writer(writer)
            .begin_nd()?;
        npy.extend(self.rgba.iter().copied())?;
        npy.finish()
    }

    /// Writes the kind of file that the ending of `path` stands for. It writes a temporary name beside it and then renames, so
    /// that a failure leaves no half file.
    ///
    /// # Errors
    /// [`ImageError`] for another ending, or when the system refuses. An earlier file at `path` is then untouched.
    pub fn save(&self, path: &Path) -> Result<(), ImageError> {
        save(path, |format, file| match format {
            ImageFormat::Png => self.write_png(file),
            ImageFormat::Npy => self.write_npy(file),
        })
    }
}

/// Writes the kind of file that the ending of `path` stands for, as [`Image::save`] does.
pub(crate) fn save(
    path: &Path,
    write: impl FnOnce(ImageFormat, &mut StagedFile) -> io::Result<()>,
) -> Result<(), ImageError> {
    let format = ImageFormat::of(path)?;
    let staged = || {
        let mut file = StagedFile::create(path)?;
        write(format, &mut file)?;
        file.commit().map(drop)
    };
    staged().map_err(|source| ImageError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Image {
        let rgba = vec![0.0, 0.5, 1.0, 1.0, -1.0, 2.0, 0.2, 0.0, 1.0, 0.998, 0.0019, 0.5];
        Image { width: 1, height: 3, rgba }
    }

    #[test]
    fn png_holds_rounded_clamped_numbers() {
        let mut bytes = Vec::new();
        picture().write_png(&mut bytes).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        assert_eq!((reader.info().width, reader.info().height), (1, 3));
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, [0, 128, 255, 0, 255, 51, 255, 254, 0]);
    }

    #[test]
    fn npy_holds_the_numbers_themselves() {
        let mut bytes = Vec::new();
        picture().write_npy(&mut bytes).unwrap();
        let npy = npyz::NpyFile::new(&bytes[..]).unwrap();
        assert_eq!((npy.shape(), npy.dtype().descr().as_str()), (&[3, 1, 4][..], "'<f4'"));
        assert_eq!(npy.into_vec::<f32>().unwrap(), picture().rgba);
    }

    #[test]
    fn a_failed_write_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.png");
        picture().save(&target).unwrap();
        let before = std::fs::read(&target).unwrap();
        let broken = Image { height: 9, ..picture() };
        assert!(matches!(broken.save(&target), Err(ImageError::Write { .. })));
        assert_eq!(std::fs::read(&target).unwrap(), before);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays behind");
        assert!(matches!(picture().save(&folder.path().join("a.jpg")), Err(ImageError::Extension { .. })));
        assert!(matches!(picture().save(&folder.path().join("none/a.npy")), Err(ImageError::Write { .. })));
    }
}
