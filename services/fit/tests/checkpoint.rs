//! Checkpoints of a training: a run that goes on from one ends as one that was never interrupted, and wrong files are refused.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use sg_fit::training::checkpoint::{Checkpoint, CheckpointError, Origin};
use sg_fit::training::{
    Training, TrainingError, TrainingOptions, TrainingReport, TrainingView, ViewOptions, volume_views,
};
use sg_fit::{Options, direct_start};
use sg_scene::model::Scene;
use sg_volume::phantom::{VesselTree, transfer_function};

const STEPS: usize = 60;

struct Setup {
    start: Scene,
    views: Vec<TrainingView>,
    held_out: Vec<TrainingView>,
    options: TrainingOptions,
}

impl Setup {
    fn new(gaussians: usize) -> Self {
        let field = VesselTree::new().rasterize(24, 2).unwrap().volume().unwrap().to_field();
        let function = transfer_function();
        let options = Options { gaussians, ..Options::default() };
        let start = direct_start(&field, &function, &options, |_| {}).unwrap().scene;
        let classifier = function.classifier(field.range()).unwrap();
        let of_views = ViewOptions { views: 7, held_out: 2, size: 48, seed: 3 };
        let (views, held_out) = volume_views(&field, &classifier, &of_views, |_, _| {});
        let options =
            TrainingOptions { iterations: STEPS, measure_every: 20, shading_share: 0.25, ..TrainingOptions::default() };
        Self { start, views, held_out, options }
    }

    fn training(&self) -> Training<'_> {
        Training::new(&self.start, &self.views, &self.held_out, &self.options).unwrap()
    }

    fn origin(&self) -> Origin {
        Origin::new([1; 32], [2; 32], &self.start)
    }

    fn resumed(&self, bytes: &[u8]) -> Training<'_> {
        let checkpoint = Checkpoint::read(bytes, &self.origin()).unwrap();
        Training::resumed(&self.start, &self.views, &self.held_out, &self.options, checkpoint).unwrap()
    }

    fn written(&self, training: &Training<'_>) -> Vec<u8> {
        let mut bytes = Vec::new();
        training.write_checkpoint(&mut bytes, &self.origin()).unwrap();
        bytes
    }
}

fn steps(training: &mut Training<'_>, count: usize) {
    for _ in 0..count {
        training.step().unwrap();
    }
}

/// A report without its times.
fn timeless(mut report: TrainingReport) -> TrainingReport {
    report.seconds = 0.0;
    report.result.seconds = 0.0;
    report.measurements.iter_mut().for_each(|measurement| measurement.seconds = 0.0);
    report
}

#[test]
fn a_resumed_training_equals_an_uninterrupted_one_to_the_last_bit() {
    let setup = Setup::new(300);
    let mut whole = setup.training();
    steps(&mut whole, STEPS);
    assert!(whole.is_over());
    let (expected, report) = whole.finish().unwrap();
    assert!(report.result.iteration > 0 && expected != setup.start, "{report:?}");
    let report = timeless(report);
    for cut in [0, 1, 20, 33, STEPS - 1] {
        let mut first = setup.training();
        steps(&mut first, cut);
        let bytes = setup.written(&first);
        // The interrupted run ends with a measurement of its own; the checkpoint knows nothing of it.
        let (_, interrupted) = first.finish().unwrap();
        assert_eq!(interrupted.iterations, cut);
        let mut second = setup.resumed(&bytes);
        assert!(!second.is_over());
        steps(&mut second, STEPS - cut);
        assert!(second.is_over());
        let (scene, resumed) = second.finish().unwrap();
        assert_eq!(timeless(resumed), report, "after {cut} steps");
        assert_eq!(scene, expected, "after {cut} steps");
    }
}

#[test]
fn a_checkpoint_of_a_resumed_training_is_that_of_an_uninterrupted_one() {
    let setup = Setup::new(100);
    let mut whole = setup.training();
    steps(&mut whole, 20);
    let middle = setup.written(&whole);
    let origin = setup.origin();
    let read = |bytes: &[u8]| Checkpoint::read(bytes, &origin).unwrap();
    assert_eq!(read(&middle).iteration(), 20);
    let mut resumed = setup.resumed(&middle);
    steps(&mut whole, 5);
    steps(&mut resumed, 5);
    let (one, other) = (setup.written(&whole), setup.written(&resumed));
    // The times differ, so the states are compared: numbers, means and mean squares, before the checksum.
    let numbers = |bytes: &[u8]| bytes[bytes.len() - 32 - 3 * 84 * setup.start.len()..bytes.len() - 32].to_vec();
    assert_eq!(numbers(&one), numbers(&other));
    assert_eq!(one.len(), other.len());
    assert!(one.len() as u64 <= origin.most_bytes());
}

#[test]
fn a_checkpoint_of_something_else_is_refused() {
    let setup = Setup::new(60);
    let bytes = setup.written(&setup.training());
    let of = |sources: u8, options: u8, start: &Scene| {
        Checkpoint::read(&bytes, &Origin::new([sources; 32], [options; 32], start)).map(|_| ())
    };
    assert_eq!(of(1, 2, &setup.start), Ok(()));
    assert_eq!(of(9, 2, &setup.start), Err(CheckpointError::Sources));
    assert_eq!(of(1, 9, &setup.start), Err(CheckpointError::Options));
    let mut moved = setup.start.clone();
    moved.units[0].gaussians.position[3].x += 1.0;
    assert_eq!(of(1, 2, &moved), Err(CheckpointError::Start));
    let mut newer = bytes.clone();
    newer[6] = 77;
    let error = Checkpoint::read(&newer, &setup.origin()).unwrap_err();
    assert!(matches!(error, CheckpointError::Version { format: 77, .. }), "{error}");
    assert!(error.to_string().contains("format 77"), "{error}");
    assert_eq!(Checkpoint::read(b"PK\x03\x04", &setup.origin()), Err(CheckpointError::Foreign));
    // More steps than the training has.
    let mut training = setup.training();
    steps(&mut training, 5);
    let five = Checkpoint::read(&setup.written(&training), &setup.origin()).unwrap();
    let fewer = TrainingOptions { iterations: 4, ..setup.options };
    let refused = Training::resumed(&setup.start, &setup.views, &setup.held_out, &fewer, five).err().unwrap();
    assert!(matches!(refused, TrainingError::Checkpoint(CheckpointError::Damaged(_))), "{refused}");
}

#[test]
fn a_damaged_checkpoint_is_refused_in_proportion_to_its_bytes() {
    let setup = Setup::new(8);
    let mut training = setup.training();
    steps(&mut training, 3);
    let (bytes, origin) = (setup.written(&training), setup.origin());
    for cut in 0..bytes.len() {
        assert!(Checkpoint::read(&bytes[..cut], &origin).is_err(), "{cut}");
        let mut flipped = bytes.clone();
        flipped[cut] ^= 0x10;
        assert!(Checkpoint::read(&flipped, &origin).is_err(), "{cut}");
    }
    // With a right checksum: every count as large as it can be, and seconds that are none.
    let begin = 6 + 4 + 1 + env!("CARGO_PKG_VERSION").len() + 3 * 32;
    let sealed = |at: usize, value: [u8; 8]| {
        let mut content = bytes[..bytes.len() - 32].to_vec();
        content[at..at + 8].copy_from_slice(&value);
        let seal = blake3::hash(&content);
        [&content[..], seal.as_bytes()].concat()
    };
    let hostile = [u64::MAX, 1 << 62, 1 << 32, 1 << 19].map(u64::to_le_bytes);
    for value in hostile {
        // Gaussians, step of the best scene, measurements.
        for at in [0, 24, 32] {
            assert!(Checkpoint::read(&sealed(begin + at, value), &origin).is_err(), "{at}");
        }
    }
    for seconds in [f64::NAN, f64::INFINITY, -1.0] {
        assert!(Checkpoint::read(&sealed(begin + 16, seconds.to_le_bytes()), &origin).is_err(), "{seconds}");
    }
    // Steps are the training's matter.
    for value in hostile {
        let checkpoint = Checkpoint::read(&sealed(begin + 8, value), &origin).unwrap();
        let resumed = Training::resumed(&setup.start, &setup.views, &setup.held_out, &setup.options, checkpoint);
        assert!(matches!(resumed.err().unwrap(), TrainingError::Checkpoint(CheckpointError::Damaged(_))));
    }
    let mut longer = bytes[..bytes.len() - 32].to_vec();
    longer.extend([0; 84]);
    let seal = blake3::hash(&longer);
    longer.extend(seal.as_bytes());
    assert_eq!(Checkpoint::read(&longer, &origin), Err(CheckpointError::Damaged("it is too long")));
}
