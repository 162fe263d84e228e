//! Readers and automatic transfer functions on measured volumes, found by `SUPERGAUSSIAN_DATA`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]
#![allow(clippy::print_stderr, reason = "a skipped test says so")]

use std::path::PathBuf;

use sg_volume::histogram::Histogram;
use sg_volume::mesh::LeftOut;
use sg_volume::{Dataset, ReadOptions, Volume, automatic_transfer_function, read_dataset, read_volume, write_raw};

/// A file below the data folder, or nothing, loudly.
fn data(relative: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("SUPERGAUSSIAN_DATA") else {
        assert!(
            std::env::var_os("SUPERGAUSSIAN_REQUIRE_DATA").is_none_or(|v| v != "1"),
            "SUPERGAUSSIAN_DATA must name the data folder"
        );
        eprintln!("SKIPPED: {relative}: set SUPERGAUSSIAN_DATA to the data folder");
        return None;
    };
    Some(PathBuf::from(root).join(relative))
}

/// BLAKE3 of the values as little-endian bytes.
fn hash(volume: &Volume) -> std::io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    write_raw(volume.scalars(), &mut hasher)?;
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

/// A raw file, its size, its range and the first digits of its hash.
type Golden = (&'static str, [usize; 3], (f64, f64), &'static str);

#[test]
fn raw_volumes_have_their_size_range_and_bytes() {
    let cases: [Golden; 8] = [
        ("volumes/bonsai_256x256x256_uint8.raw.zst", [256, 256, 256], (0.0, 255.0), "092a370593daf4b4"),
        ("volumes/aneurism_256x256x256_uint8.raw.zst", [256, 256, 256], (0.0, 255.0), "813c207b4ca0d679"),
        ("volumes/tooth_103x94x161_uint8.raw.zst", [103, 94, 161], (0.0, 255.0), "357f3dd90a7981f6"),
        ("volumes/neghip_64x64x64_uint8.raw.zst", [64, 64, 64], (0.0, 255.0), "7ff07f00ba97d143"),
        ("volumes/embryo_256x256x256_uint8.raw.zst", [256, 256, 256], (0.0, 197.0), "5a3e30929ea3e5db"),
        ("volumes/lobster_small_120x120x34_uint8.raw.zst", [120, 120, 34], (0.0, 255.0), "ef2afa6b3ceb7eba"),
        ("volumes/headsq_quarter_64x64x93_int16.raw.zst", [64, 64, 93], (0.0, 3926.0), "99af36438262f4e2"),
        ("labels/frogtissue_labels_500x470x136_uint8.raw.zst", [500, 470, 136], (0.0, 29.0), "bfe3f66014829f44"),
    ];
    let mut wrong = Vec::new();
    for (name, dims, (low, high), digest) in cases {
        let Some(path) = data(name) else { return };
        let volume = read_volume(&path).unwrap();
        let range = volume.scalars().range();
        assert_eq!(volume.grid().dims(), dims, "{name}");
        assert_eq!((range.low, range.high, range.non_finite), (low, high, 0), "{name}");
        let found = hash(&volume).unwrap();
        if found != digest {
            wrong.push(format!("{name}: {found}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn containers_hold_the_same_values_as_the_raw_files() {
    for (container, raw, variable) in [
        ("containers/aneurism.vti", "volumes/aneurism_256x256x256_uint8.raw.zst", Some("ImageFile")),
        ("containers/tooth.nrrd", "volumes/tooth_103x94x161_uint8.raw.zst", None),
    ] {
        let (Some(container), Some(raw)) = (data(container), data(raw)) else { return };
        let (a, b) = (read_volume(&container).unwrap(), read_volume(&raw).unwrap());
        assert_eq!(a.scalars(), b.scalars());
        assert_eq!(a.grid(), b.grid());
        assert_eq!(a.variable(), variable);
    }
}

#[test]
fn automatic_functions_find_the_materials_that_are_there() {
    // Material count and a value that belongs to the densest one.
    for (name, materials, dense) in [
        ("volumes/bonsai_256x256x256_uint8.raw.zst", 3, 205.0),
        ("volumes/aneurism_256x256x256_uint8.raw.zst", 1, 250.0),
        ("volumes/tooth_103x94x161_uint8.raw.zst", 3, 235.0),
        ("volumes/lobster_small_120x120x34_uint8.raw.zst", 1, 200.0),
    ] {
        let Some(path) = data(name) else { return };
        let field = read_volume(&path).unwrap().to_field();
        let function = automatic_transfer_function(&field, None).unwrap();
        function.check().unwrap();
        assert_eq!(function.base_units.len(), materials, "{name}: {function:?}");
        let classifier = function.classifier(field.range()).unwrap();
        assert_eq!(classifier.unit(dense).unit, materials - 1, "{name}");
        assert!(classifier.opacity(dense) >= 0.5, "{name}");
        // The most frequent values are the air around.
        let histogram = Histogram::of(&field, field.range().low, field.range().high);
        let most = (0..histogram.counts.len()).max_by_key(|&i| histogram.counts[i]).unwrap();
        assert_eq!(classifier.opacity(histogram.border(most)), 0.0, "{name}");
    }
}

#[test]
fn meshes_have_their_tetrahedra_and_quantities() {
    let cases = [
        ("meshes/bluntfin_187395tets.vtu.zst", 40_960, 187_395, 77, Some("energy")),
        ("meshes/comb_215040tets.vtu.zst", 47_025, 215_040, 0, None),
    ];
    for (name, points, tetrahedra, flat, energy) in cases {
        let Some(path) = data(name) else { return };
        let read = |variable: Option<&str>| {
            let options = ReadOptions { variable: variable.map(str::to_owned), ..ReadOptions::default() };
            match read_dataset(&path, &options).unwrap() {
                Dataset::Mesh(mesh) => mesh,
                Dataset::Volume(_) => panic!("{name} is a mesh"),
            }
        };
        let mesh = read(None);
        assert_eq!(mesh.variable(), Some("density"), "{name}");
        assert_eq!((mesh.points().len(), mesh.cells().len()), (points, tetrahedra - flat), "{name}");
        assert_eq!(mesh.left_out(), LeftOut { flat, non_finite: 0 }, "{name}");
        let range = |variable: &str| read(Some(variable)).to_field().range();
        let (length, along) = (range("momentum"), range("momentum:x"));
        assert!(length.low >= 0.0 && along.high <= length.high && -along.low <= length.high, "{length:?} {along:?}");
        if let Some(energy) = energy {
            assert!(range(energy).low > 0.0);
        }
        assert!(read_volume(&path).unwrap_err().to_string().contains("a mesh, where voxels are needed"));
    }
}
