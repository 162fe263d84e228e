//! Well-known formats that no reader of this project takes: a name for people, and a way to a format that can be read.
//!
//! Readers ask here after they have found no format of their own.

use std::fmt;
use std::path::Path;

use crate::file;

/// Bytes of a file that are looked at.
const START: u64 = 512;
/// Most entries of a folder that are looked at, and most files among them that are opened.
const ENTRIES: usize = 64;

/// A format that cannot be read.
#[derive(Debug)]
pub struct UnreadableFormat {
    /// Its name, with an article where the sentence "… cannot be read" needs one.
    pub name: &'static str,
    /// A way to a format that can be read.
    pub remedy: &'static str,
    /// Endings of its files, in lower case with the dot.
    pub endings: &'static [&'static str],
    /// Offsets and bytes, each of which shows the format.
    magics: &'static [(usize, &'static [u8])],
}

const fn row(
    name: &'static str,
    endings: &'static [&'static str],
    magics: &'static [(usize, &'static [u8])],
    remedy: &'static str,
) -> UnreadableFormat {
    UnreadableFormat { name, remedy, endings, magics }
}

const HDF5: (usize, &[u8]) = (0, b"\x89HDF\r\n\x1a\n");
const NETCDF: [(usize, &[u8]); 3] = [(0, b"CDF\x01"), (0, b"CDF\x02"), (0, b"CDF\x05")];
const ZIP: (usize, &[u8]) = (0, b"PK\x03\x04");
const GZIP: (usize, &[u8]) = (0, b"\x1f\x8b");

const FROM_SLICER: &str = "save it as NRRD from 3D Slicer";
const FROM_FIJI: &str = "open it in Fiji and save it as NRRD";
const FROM_PARAVIEW: &str = "resample it to an image in ParaView and save it as .vti";
const AS_RAW: &str = "write its array as raw voxels with a name like heart_256x256x128_uint16.raw";
const FROM_NETCDF: &str = "open it in ParaView, resample it to an image and save it as .vti, or a mesh as .vtu";
const FROM_HDF5: &str = "open it in Fiji and save it as NRRD, or with an XDMF file in ParaView and save it as .vti";
const AS_PLY: &str = "convert it to .ply with PlayCanvas splat-transform";
const FROM_MESH: &str = "a mesh has no voxels; make a label map of it in 3D Slicer and save that as NRRD";
const FROM_POINTS: &str = "points are no Gaussians; train Gaussians on pictures of the place and give their PLY";

/// The formats. Of several with the same first bytes the ending chooses, else the first one; for ZIP and gzip it is the last one.
pub static UNREADABLE: &[UnreadableFormat] = &[
    // A volume reader takes it; who looks for Gaussians alone asks here.
    row("DICOM as a scene", &[], &[(128, b"DICM")], "make a scene of it with `supergaussian fit`"),
    row("Analyze, or NIfTI in two files,", &[".hdr", ".img", ".hdr.gz", ".img.gz"], &[], FROM_SLICER),
    row("FreeSurfer MGH", &[".mgh", ".mgz"], &[], FROM_SLICER),
    row("Philips PAR/REC", &[".par", ".rec"], &[], "convert it to NIfTI with dcm2niix"),
    row("HDF5", &[".h5", ".hdf5", ".hdf", ".ims"], &[HDF5], FROM_HDF5),
    row("NetCDF", &[".nc", ".nc4", ".cdf"], &[NETCDF[0], NETCDF[1], NETCDF[2], HDF5], FROM_NETCDF),
    row("MINC", &[".mnc"], &[NETCDF[0], NETCDF[1], NETCDF[2], HDF5], "convert it to NIfTI with mnc2nii"),
    row("MATLAB", &[".mat"], &[(0, b"MATLAB 5.0"), HDF5], AS_RAW),
    row("NumPy", &[".npy"], &[(0, b"\x93NUMPY")], AS_RAW),
    row("NumPy", &[".npz"], &[ZIP], AS_RAW),
    row("OpenVDB", &[".vdb"], &[(0, b" BDV\0\0\0\0")], AS_RAW),
    row("TIFF", &[".tif", ".tiff", ".btf"], &[(0, b"II*\0"), (0, b"MM\0*"), (0, b"II+\0"), (0, b"MM\0+")], FROM_FIJI),
    row("Zeiss CZI", &[".czi"], &[(0, b"ZISRAWFILE")], FROM_FIJI),
    row("Nikon ND2", &[".nd2"], &[(0, b"\xda\xce\xbe\x0a")], FROM_FIJI),
    row("Leica LIF", &[".lif"], &[], FROM_FIJI),
    row("MRC", &[".mrc", ".map", ".ccp4"], &[(208, b"MAP ")], FROM_FIJI),
    row(
        "A single picture",
        &[".png", ".jpg", ".jpeg"],
        &[(0, b"\x89PNG\r\n"), (0, b"\xff\xd8\xff")],
        "open the whole stack of slices in Fiji and save it as NRRD",
    ),
    row("VTK without a regular grid", &[".vtp", ".vts", ".vtr", ".pvti", ".pvtu"], &[], FROM_PARAVIEW),
    row("LAS", &[".las", ".laz"], &[(0, b"LASF")], FROM_POINTS),
    row("E57", &[".e57"], &[(0, b"ASTM-E57")], FROM_POINTS),
    row("PCD", &[".pcd"], &[(0, b"# .PCD")], FROM_POINTS),
    row(
        "glTF",
        &[".gltf", ".glb"],
        &[(0, b"glTF")],
        "export it as STL from Blender; in 3D Slicer make a label map of \
        that and save it as NRRD",
    ),
    row("STL", &[".stl"], &[(0, b"solid ")], FROM_MESH),
    row("OBJ", &[".obj"], &[], FROM_MESH),
    row("FBX", &[".fbx"], &[(0, b"Kaydara FBX Binary")], FROM_MESH),
    row("KSPLAT", &[".ksplat"], &[], AS_PLY),
    row("SPZ", &[".spz"], &[(0, b"NGSP"), GZIP], AS_PLY),
    row("SOG", &[".sog"], &[ZIP], AS_PLY),
    row(
        "An archive",
        &[".zip", ".tar", ".tar.gz", ".tgz", ".7z", ".rar", ".gz"],
        &[ZIP, (257, b"ustar"), GZIP, (0, b"7z\xbc\xaf"), (0, b"Rar!")],
        "unpack it and give a file in it",
    ),
];

/// A folder of Zarr arrays.
static ZARR: UnreadableFormat = row("Zarr", &[".zarr"], &[], FROM_FIJI);

impl UnreadableFormat {
    fn has_ending(&self, name: &str) -> bool {
        self.endings.iter().any(|ending| name.ends_with(ending))
    }

    fn has_magic(&self, start: &[u8]) -> bool {
        self.magics.iter().any(|(at, magic)| start.get(*at..).is_some_and(|bytes| bytes.starts_with(magic)))
    }
}

/// A file or folder in a format that cannot be read.
#[derive(Debug, Clone, Copy)]
pub struct Recognised {
    /// The format.
    pub format: &'static UnreadableFormat,
    /// The evidence: "content", "file name" or "folder".
    pub place: &'static str,
}

impl Recognised {
    /// The finding, as half a sentence for a person.
    #[must_use]
    pub fn what(&self) -> String {
        format!("{} cannot be read", self.format.name)
    }
}

impl fmt::Display for Recognised {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.what(), self.format.remedy)
    }
}

/// The unreadable format of a file or folder, if it is a known one. The content decides before the name does. A file that
/// cannot be opened is judged by its name.
///
/// Of a file the first 512 bytes are read; of a folder at most 64 entries are looked at.
#[must_use]
pub fn recognise(path: &Path) -> Option<Recognised> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if path.is_dir() {
        return folder(path, &name).map(|format| Recognised { format, place: "folder" });
    }
    let start = file::read_start(path, START).unwrap_or_default();
    let by_both = UNREADABLE.iter().find(|f| f.has_magic(&start) && f.has_ending(&name));
    // A ZIP or gzip without a known ending is an archive, which stands last; of other containers the general row stands first.
    let first = |f: &&UnreadableFormat| f.has_magic(&start);
    let of_content = || {
        if start.starts_with(ZIP.1) || start.starts_with(GZIP.1) {
            UNREADABLE.iter().rfind(first)
        } else {
            UNREADABLE.iter().find(first)
        }
    };
    let by_content = by_both.or_else(of_content);
    if let Some(format) = by_content {
        return Some(Recognised { format, place: "content" });
    }
    UNREADABLE.iter().find(|f| f.has_ending(&name)).map(|format| Recognised { format, place: "file name" })
}

fn folder(path: &Path, name: &str) -> Option<&'static UnreadableFormat> {
    if ZARR.has_ending(name) || [".zarray", ".zgroup", "zarr.json"].iter().any(|file| path.join(file).exists()) {
        return Some(&ZARR);
    }
    let entries = std::fs::read_dir(path).ok()?;
    let files = entries.take(ENTRIES).flatten().map(|entry| entry.path());
    files.filter(|file| file.is_file()).find_map(|file| {
        let start = file::read_start(&file, START).ok()?;
        UNREADABLE.first().filter(|dicom| dicom.has_magic(&start))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn padded(at: usize, magic: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; at];
        bytes.extend(magic);
        bytes.resize(600, 0);
        bytes
    }

    #[test]
    fn content_tells_the_format_under_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("unnamed");
        for (at, magic, name) in [
            (128, &b"DICM"[..], "DICOM as a scene"),
            (0, b"\x89HDF\r\n\x1a\n", "HDF5"),
            (0, b"CDF\x01", "NetCDF"),
            (0, b"CDF\x02", "NetCDF"),
            (0, b"MATLAB 5.0 MAT-file", "MATLAB"),
            (0, b"\x93NUMPY\x01\0", "NumPy"),
            (0, b" BDV\0\0\0\0", "OpenVDB"),
            (0, b"II*\0\x08\0\0\0", "TIFF"),
            (0, b"MM\0*", "TIFF"),
            (0, b"II+\0", "TIFF"),
            (0, b"ZISRAWFILE\0", "Zeiss CZI"),
            (0, b"\xda\xce\xbe\x0a", "Nikon ND2"),
            (208, b"MAP DA\0\0", "MRC"),
            (0, b"\x89PNG\r\n\x1a\n", "A single picture"),
            (0, b"\xff\xd8\xff\xe0", "A single picture"),
            (0, b"LASF", "LAS"),
            (0, b"ASTM-E57", "E57"),
            (0, b"# .PCD v0.7", "PCD"),
            (0, b"glTF\x02\0\0\0", "glTF"),
            (0, b"solid part\n", "STL"),
            (0, b"Kaydara FBX Binary  \0", "FBX"),
            (0, b"NGSP", "SPZ"),
            (0, b"PK\x03\x04", "An archive"),
            (257, b"ustar\0", "An archive"),
            (0, b"\x1f\x8b\x08", "An archive"),
        ] {
            std::fs::write(&path, padded(at, magic)).unwrap();
            let found = recognise(&path).unwrap_or_else(|| panic!("{name} is not recognised"));
            assert_eq!((found.format.name, found.place), (name, "content"));
        }
        std::fs::write(&path, padded(0, b"nothing known")).unwrap();
        assert!(recognise(&path).is_none());
    }

    #[test]
    fn every_ending_names_its_row_and_a_container_is_told_by_its_ending() {
        let dir = tempfile::tempdir().unwrap();
        for format in UNREADABLE {
            for ending in format.endings {
                assert!(ending.starts_with('.') && ending.to_lowercase() == *ending, "{ending}");
                let path = dir.path().join(format!("FILE{}", ending.to_uppercase()));
                let magic = format.magics.first().copied().unwrap_or((0, b"unknown"));
                for content in [padded(magic.0, magic.1), Vec::new()] {
                    std::fs::write(&path, content).unwrap();
                    let found = recognise(&path).unwrap();
                    let line = found.to_string();
                    assert_eq!(found.format.name, format.name, "{ending}");
                    assert!(line.contains(" cannot be read; ") && !line.ends_with('.'), "{line}");
                }
            }
        }
    }

    #[test]
    fn folders_of_slices_and_arrays_are_recognised() {
        let dir = tempfile::tempdir().unwrap();
        let name = |path: &Path| recognise(path).map(|found| found.format.name);
        assert_eq!(name(dir.path()), None);
        std::fs::write(dir.path().join("README"), "slices").unwrap();
        std::fs::write(dir.path().join("IM0001"), padded(128, b"DICM")).unwrap();
        assert_eq!(name(dir.path()), Some("DICOM as a scene"));
        let zarr = dir.path().join("cells");
        std::fs::create_dir(&zarr).unwrap();
        std::fs::write(zarr.join(".zarray"), "{}").unwrap();
        assert_eq!(name(&zarr), Some("Zarr"));
    }
}
