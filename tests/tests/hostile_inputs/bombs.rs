//! Small files that would become large.

use std::io::Write;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use zip::CompressionMethod;
use zip::write::SimpleFileOptions;

use crate::case::{Case, Ending};
use crate::readers::{self, RIGHT};

fn zeros(mut write: impl FnMut(&[u8]), mib: usize) {
    let piece = vec![0; 1 << 20];
    (0..mib).for_each(|_| write(&piece));
}

fn gzip(mib: usize) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::fast());
    zeros(|piece| out.write_all(piece).unwrap(), mib);
    out.finish().unwrap()
}

fn zstd(mib: usize) -> Vec<u8> {
    let mut out = zstd::Encoder::new(Vec::new(), 1).unwrap();
    zeros(|piece| out.write_all(piece).unwrap(), mib);
    out.finish().unwrap()
}

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut fit = |name: &str, bytes: Vec<u8>| {
        let case = Case::new("bombs", name, &["fit", name, "--initial-only", "--out", "to"]);
        cases.push(case.bytes(name, bytes));
    };
    // They hold what they promise, and less, and more.
    fit("a_1024x1024x256_uint8.raw.gz", gzip(256));
    fit("a_1024x1024x255_uint8.raw.gz", gzip(256));
    fit("a_1024x1024x257_uint8.raw.gz", gzip(256));
    fit("a_8x8x8_uint8.raw.gz", gzip(256));
    fit("a_1024x1024x512_uint8.raw.zst", zstd(512));
    fit("a_2000x2000x2000_uint8.raw.zst", zstd(512));
    fit("a_8x8x8_uint8.raw.zst", zstd(512));
    fit("a_512x512x512_float64.raw.zst", zstd(1024));
    let nrrd = |sizes: &str| [readers::nrrd(sizes, "uint8", "gzip").into_bytes(), gzip(256)].concat();
    fit("a.nrrd", nrrd("1024 1024 256"));
    fit("b.nrrd", nrrd("8 8 8"));
    fit("c.nrrd", nrrd("2000 2000 2000"));
    let nifti = |dims: [i16; 3]| {
        let mut out = GzEncoder::new(readers::nifti(dims, &[]), Compression::fast());
        zeros(|piece| out.write_all(piece).unwrap(), 256);
        let whole = out.finish().unwrap();
        // The header belongs into the stream.
        let mut out = GzEncoder::new(Vec::new(), Compression::fast());
        out.write_all(&whole[..352]).unwrap();
        zeros(|piece| out.write_all(piece).unwrap(), 256);
        out.finish().unwrap()
    };
    let metaimage = |sizes: &str| {
        let mut out = ZlibEncoder::new(Vec::new(), Compression::fast());
        zeros(|piece| out.write_all(piece).unwrap(), 256);
        let header = readers::metaimage(sizes, "MET_UCHAR", "CompressedData = True\n");
        [header.into_bytes(), out.finish().unwrap()].concat()
    };
    fit("a.mha", metaimage("1024 1024 256"));
    fit("b.mha", metaimage("8 8 8"));
    fit("c.mha", metaimage("2000 2000 2000"));
    fit("a.nii.gz", nifti([1024, 1024, 256]));
    fit("b.nii.gz", nifti([8, 8, 8]));
    fit("c.nii.gz", nifti([2000, 2000, 2000]));
    let block = |mib: usize| {
        let mut out = ZlibEncoder::new(Vec::new(), Compression::fast());
        zeros(|piece| out.write_all(piece).unwrap(), mib);
        out.finish().unwrap()
    };
    let vti = |extent: &str, mib: usize| {
        let packed = block(mib);
        let numbers = [1, (mib << 20) as u32, 0, packed.len() as u32];
        let data: Vec<u8> = numbers.into_iter().flat_map(u32::to_le_bytes).chain(packed).collect();
        let head = format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\">\
             <ImageData WholeExtent=\"{extent}\"><Piece Extent=\"{extent}\"><PointData Scalars=\"d\">\
             <DataArray type=\"UInt8\" Name=\"d\" format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData>\
             <AppendedData encoding=\"raw\">_"
        );
        [head.as_bytes(), &data, b"</AppendedData></VTKFile>"].concat()
    };
    let vtu = |points: u64, mib: usize| {
        let packed = block(mib);
        let numbers = [1, (mib << 20) as u32, 0, packed.len() as u32];
        let data: Vec<u8> = numbers.into_iter().flat_map(u32::to_le_bytes).chain(packed).collect();
        let array = |name: &str, kind: &str, components: usize| {
            format!(
                "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"0\"/>"
            )
        };
        let head = format!(
            "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\">\
             <UnstructuredGrid><Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{points}\"><PointData>{}</PointData>\
             <Points>{}</Points><Cells>{}{}{}</Cells></Piece></UnstructuredGrid><AppendedData encoding=\"raw\">_",
            array("d", "Float32", 1),
            array("p", "Float32", 3),
            array("connectivity", "Int64", 1),
            array("offsets", "Int64", 1),
            array("types", "UInt8", 1),
        );
        [head.as_bytes(), &data, b"</AppendedData></VTKFile>"].concat()
    };
    fit("a.vtu", vtu(20_000_000, 256));
    fit("b.vtu", vtu(8, 256));
    fit("c.vtu", vtu(u64::MAX, 1));
    let mut packed = zstd::Encoder::new(Vec::new(), 1).unwrap();
    zeros(|piece| packed.write_all(piece).unwrap(), 256);
    fit("a.vtu.zst", packed.finish().unwrap());
    let vtk = |cells: &str| {
        format!(
            "# vtk DataFile Version 4.2\nlarge\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {cells} float\n\
             CELLS {cells} {cells}\nCELL_TYPES {cells}\nPOINT_DATA {cells}\nSCALARS d float\nLOOKUP_TABLE default\n"
        )
    };
    fit("a.vtk", vtk("4000000000").into_bytes());
    fit("b.vtk", vtk("18446744073709551615").into_bytes());
    let grid = "# vtk DataFile Version 4.2\nlarge\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 100000 100000 100000\n";
    fit("c.vtk", grid.to_owned().into_bytes());
    fit("a.vti", vti("0 1023 0 1023 0 255", 256));
    fit("b.vti", vti("0 7 0 7 0 7", 256));
    fit("c.vti", vti("0 1999 0 1999 0 1999", 256));
    let attributes: String = (0..150_000).map(|i| format!(" a{i}=\"\"")).collect();
    fit("d.vti", format!("<VTKFile{attributes} type=\"ImageData\"></VTKFile>").into_bytes());
    fit(
        "e.vti",
        "<VTKFile type=\"ImageData\">".to_owned().into_bytes().into_iter().chain(b"<a>".repeat(400_000)).collect(),
    );

    cases.extend(palettes());
    cases
}

/// A checkpoint with these entries.
fn zipped(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        zip.start_file(format!("archive/{name}"), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// Checkpoints beside a unit.
fn palettes() -> Vec<Case> {
    let mut cases = Vec::new();
    let reader = readers::named("palette");
    let mut add = |name: &str, bytes: Vec<u8>| {
        cases.push(reader.case("bombs", name, &reader.file()).bytes(&reader.file(), bytes).ending(Ending::Refused));
    };
    let pickle = |body: &[u8]| [b"\x80\x02", body, b"."].concat();
    add("a pickle of 200 MiB", {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        zip.start_file("archive/data.pkl", options).unwrap();
        zeros(|piece| zip.write_all(piece).unwrap(), 200);
        zip.finish().unwrap().into_inner()
    });
    add("a pickle of nothing", zipped(&[("data.pkl", Vec::new())]));
    add("a call", zipped(&[("data.pkl", pickle(b"cos\nsystem\nX\x04\x00\x00\x00true\x85R"))]));
    add("deep tuples", zipped(&[("data.pkl", pickle(&[&b")"[..], &b"\x85".repeat(1_000_000)].concat()))]));
    add(
        "a shared list of lists",
        zipped(&[(
            "data.pkl",
            pickle(&[b"]q\x00".to_vec(), b"]q\x01(h\x00h\x00e0h\x01q\x00".repeat(60_000)].concat()),
        )]),
    );
    add("a memo far away", zipped(&[("data.pkl", pickle(b"Nr\xff\xff\xff\x7f"))]));
    add("a text of four gigabytes", zipped(&[("data.pkl", pickle(b"X\xff\xff\xff\xff"))]));
    add("an unknown opcode", zipped(&[("data.pkl", pickle(b"\xff"))]));
    add("names that escape", zipped(&[("\u{1b}[2J", Vec::new()), ("../../data.pkl", b"\x80\x02N.".to_vec())]));
    let names: Vec<String> = (0..5000).map(|i| format!("data/{i}")).collect();
    let entries: Vec<(&str, Vec<u8>)> = names.iter().map(|name| (name.as_str(), Vec::new())).collect();
    add("many entries", zipped(&entries));
    add("no zip", b"PK\x03\x04".repeat(1000));
    add("a zip that is cut off", {
        let whole = zipped(&[("data.pkl", pickle(b"N"))]);
        whole[..whole.len() / 2].to_vec()
    });
    let mut entries = RIGHT.of("ply");
    entries.extend(b"PK\x05\x06\x00\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\x00\x00");
    add("a directory that is not there", entries);
    cases
}
