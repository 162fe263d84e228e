//! The table of all passes of a frame: the one description of what each command reads, writes and waits for.
//!
//! `described_frames_are_those_that_are_recorded` compares it with the commands that [`crate::Renderer`] encodes: entry points, kinds,
//! variables with their access, and barriers. A changed pass changes its lines here.
//!
//! Bytes are those of the addresses that a workgroup or a draw touches, each address once: what it asks of the caches. An indirect
//! read of a small table (units, edits, arguments) counts nothing.

use encase::ShaderSize;
use sg_raster::TILE;
use sg_raster::counts::Counts;

use super::{Frame, Pass, TargetFormat};
use crate::barriers::{Access, Kind};
use crate::settings::Rasterizer;
use crate::shader_layout::{
    BANDS, Center, Ellipse, LANES, Level, MARK_WORDS, NearRay, SORT_BITS, SORT_BLOCK, Shape, TileList, Tint,
};

/// Bytes of an index, a key, a depth or a count.
const WORD: u64 = u32::SHADER_SIZE.get();

/// Bytes of a pixel of the tiles.
const TILE_PIXEL: u64 = glam::Vec4::SHADER_SIZE.get();

/// Bytes of a pixel of a window's or a headset's image.
const IMAGE_PIXEL: u64 = 4;

/// Bytes of a pixel of the depth buffer of the bands: [`crate::textures::REJECT_DEPTH_FORMAT`].
const REJECT_PIXEL: u64 = 2;

/// Resource of a command.
#[derive(Debug, Clone, Copy)]
pub(super) struct Resource {
    /// Name of the shader's variable; empty for arguments and attachments.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare it with the commands of a device"))]
    pub(super) variable: &'static str,
    /// Name of the buffer or texture, and its number among those of the name.
    pub(super) name: (&'static str, u32),
    pub(super) access: Access,
    pub(super) read: u64,
    pub(super) written: u64,
}

impl Resource {
    /// A buffer that is bound read-only under its own name.
    fn read(variable: &'static str, bytes: u64) -> Self {
        Self { variable, name: (variable, 0), access: Access::Read, read: bytes, written: 0 }
    }

    /// A buffer that is bound for writing under its own name.
    fn write(variable: &'static str, read: u64, written: u64) -> Self {
        Self { variable, name: (variable, 0), access: Access::Write, read, written }
    }

    /// The same under the name of another buffer.
    fn of(self, name: &'static str, number: u32) -> Self {
        Self { name: (name, number), ..self }
    }

    fn arguments(name: &'static str) -> Self {
        Self { variable: "", name: (name, 0), access: Access::Indirect, read: 0, written: 0 }
    }

    fn sampled(name: &'static str, number: u32, bytes: u64) -> Self {
        Self { variable: "", name: (name, number), access: Access::Sampled, read: bytes, written: 0 }
    }

    fn target(name: &'static str, number: u32, read: u64, written: u64) -> Self {
        Self { variable: "", name: (name, number), access: Access::Attachment, read, written }
    }
}

/// A command of a frame.
#[derive(Debug, Clone)]
pub(super) struct Command {
    pub(super) pass: Pass,
    /// Whether it is the first one of a compute or draw pass.
    pub(super) opens_pass: bool,
    /// The entry point; that of the fragments for draws.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare it with the commands of a device"))]
    pub(super) entry: &'static str,
    pub(super) kind: Kind,
    pub(super) resources: Vec<Resource>,
    /// Fragments that are blended.
    pub(super) blended: u64,
    /// Fragments that are written without blending.
    pub(super) stored: u64,
}

/// Commands in their order.
struct Table {
    commands: Vec<Command>,
    pass: Pass,
    opens_pass: bool,
}

impl Table {
    fn begin(&mut self, pass: Pass) {
        (self.pass, self.opens_pass) = (pass, true);
    }

    fn add(&mut self, entry: &'static str, kind: Kind, resources: Vec<Resource>) -> &mut Command {
        let opens_pass = std::mem::take(&mut self.opens_pass);
        let at = self.commands.len();
        self.commands.push(Command { pass: self.pass, opens_pass, entry, kind, resources, blended: 0, stored: 0 });
        &mut self.commands[at]
    }

    /// The begin of a buffer becomes zero.
    fn clear(&mut self, name: &'static str, bytes: u64) {
        let target = Resource { access: Access::CopyTarget, ..Resource::write("", 0, bytes).of(name, 0) };
        self.add("clear", Kind::Clear, vec![target]);
    }

    fn dispatch(&mut self, entry: &'static str, resources: Vec<Resource>) {
        self.add(entry, Kind::Dispatch, resources);
    }

    fn indirect(&mut self, entry: &'static str, arguments: &'static str, mut resources: Vec<Resource>) {
        resources.push(Resource::arguments(arguments));
        self.add(entry, Kind::DispatchIndirect, resources);
    }

    /// A triangle over a whole target.
    fn full_screen(&mut self, pass: Pass, entry: &'static str, pixels: u64, resources: Vec<Resource>) {
        self.begin(pass);
        self.add(entry, Kind::Draw, resources).stored = pixels;
    }
}

/// All commands of a frame.
pub(super) fn commands(frame: &Frame, counts: &Counts) -> Vec<Command> {
    let mut table = Table { commands: Vec::new(), pass: Pass::Cull, opens_pass: false };
    splats(&mut table, frame, counts);
    match frame.rasterizer {
        Rasterizer::Tiles => tiles(&mut table, frame, counts),
        Rasterizer::Quads => quads(&mut table, frame, counts, 1),
        Rasterizer::Bands => quads(&mut table, frame, counts, BANDS),
    }
    if frame.rasterizer != Rasterizer::Tiles {
        compose(&mut table, frame);
    }
    if frame.depths && frame.rasterizer != Rasterizer::Tiles {
        depths(&mut table, frame, counts);
    }
    if frame.presented {
        present(&mut table, frame);
    }
    table.commands
}

/// Mark, list, project, sort: see `splats`.
fn splats(table: &mut Table, frame: &Frame, counts: &Counts) {
    let Frame { parts, .. } = *frame;
    let share = |count: u64, part: u64| count * (part + 1) / parts - count * part / parts;
    let blocks = counts.gaussians.div_ceil(crate::shader_layout::BLOCK.into());
    table.clear("near_rays", 16);
    table.begin(Pass::Cull);
    for part in 0..parts {
        let (n, blocks) = (share(counts.gaussians, part), share(blocks, part));
        let edits = frame.mask_bits * n / 8;
        table.dispatch("mark", {
            vec![
                Resource::read("centers", Center::SHADER_SIZE.get() * n).of("centers", part as u32),
                Resource::read("shapes", Shape::SHADER_SIZE.get() * n).of("shapes", part as u32),
                Resource::read("units", 0),
                Resource::read("edits", 0),
                Resource::read("masks", edits),
                Resource::read("clip_sides", 0),
                Resource::write("marked", 0, WORD * u64::from(MARK_WORDS) * blocks),
                Resource::write("block_counts", 0, WORD * blocks),
            ]
        });
    }
    table.dispatch(
        "sum_blocks",
        vec![
            Resource::write("block_counts", WORD * blocks, WORD * blocks),
            Resource::write("part_ranges", 0, 0),
            Resource::write("totals", 0, 0),
            Resource::write("dispatches", 0, 0),
            Resource::write("part_dispatches", 0, 0),
            Resource::read("parts", 0),
        ],
    );
    for part in 0..parts {
        let (listed, blocks) = (share(counts.listed, part), share(blocks, part));
        table.dispatch(
            "list",
            vec![
                Resource::read("marked", WORD * u64::from(MARK_WORDS) * blocks),
                Resource::write("block_counts", WORD * blocks, 0),
                Resource::write("listed", 0, WORD * listed),
            ],
        );
    }
    table.begin(Pass::Project);
    for part in 0..parts {
        let n = share(counts.listed, part);
        let splats = n * counts.views;
        let colored = if frame.colors { 3 * WORD * n } else { 0 };
        table.indirect(
            "project",
            "part_dispatches",
            vec![
                Resource::read("centers", Center::SHADER_SIZE.get() * n).of("centers", part as u32),
                Resource::read("shapes", Shape::SHADER_SIZE.get() * n).of("shapes", part as u32),
                Resource::read("units", 0),
                Resource::read("edits", 0),
                Resource::read("masks", frame.mask_bits * n / 8),
                Resource::read("surfaces", frame.surface_bytes * n).of("surfaces", part as u32),
                Resource::read("harmonics", frame.harmonic_bytes * n).of("harmonics", part as u32),
                Resource::read("colors", colored),
                Resource::read("clip_sides", 0),
                Resource::read("part_ranges", 0),
                Resource::read("listed", WORD * n),
                Resource::write("ellipses", 0, Ellipse::SHADER_SIZE.get() * splats),
                Resource::write("levels", 0, Level::SHADER_SIZE.get() * splats),
                Resource::write("tints", 0, Tint::SHADER_SIZE.get() * splats),
                Resource::write("rays", 0, 0),
                Resource::write("depth_keys", 0, WORD * n).of("depth keys", 0),
                Resource::write("depth_places", 0, WORD * n).of("depth values", 0),
                Resource::write("near_rays", 0, NearRay::SHADER_SIZE.get() * share(counts.by_rays, part)),
            ],
        );
    }
    table.begin(Pass::Sort);
    let names = ["depth keys", "depth values", "depth digits"];
    sort(table, names, "dispatches", (counts.listed, DEPTH_BITS));
}

/// Bits of a depth that are sorted.
const DEPTH_BITS: u32 = u32::BITS;

/// The buffer of the depth order.
fn depth_order(bytes: u64) -> Resource {
    Resource::read("depth_order", bytes).of("depth values", DEPTH_BITS.div_ceil(SORT_BITS) % 2)
}

/// A sort of keys by their lowest bits: see `radix_sort`.
fn sort(table: &mut Table, [keys, values, digits]: [&'static str; 3], arguments: &'static str, (n, bits): (u64, u32)) {
    let words = WORD * n;
    let counted = (WORD << SORT_BITS) * n.div_ceil(SORT_BLOCK.into());
    for pass in 0..bits.div_ceil(SORT_BITS) {
        let (from, to) = (pass % 2, 1 - pass % 2);
        let totals = Resource::read("totals", 0);
        table.indirect(
            "count",
            arguments,
            vec![
                totals,
                Resource::read("keys", words).of(keys, from),
                Resource::write("digit_counts", 0, counted).of(digits, 0),
            ],
        );
        table.dispatch("scan", vec![totals, Resource::write("digit_counts", counted, counted).of(digits, 0)]);
        table.indirect(
            "scatter",
            arguments,
            vec![
                totals,
                Resource::read("keys", words).of(keys, from),
                Resource::read("values", words).of(values, from),
                Resource::write("sorted_keys", 0, words).of(keys, to),
                Resource::write("sorted_values", 0, words).of(values, to),
                Resource::write("digit_counts", counted, 0).of(digits, 0),
            ],
        );
    }
}

/// Lists and blending of tiles: see `tiles`.
fn tiles(table: &mut Table, frame: &Frame, counts: &Counts) {
    let items = counts.listed * counts.views;
    let blocks = WORD * items.div_ceil(LANES.into());
    let tiles = counts.views * frame.size.map(|pixels| u64::from(pixels).div_ceil(TILE as u64)).iter().product::<u64>();
    // The greatest key is the number of tiles less one.
    let bits = (u64::BITS - tiles.saturating_sub(1).leading_zeros()).max(1);
    let sorted = bits.div_ceil(SORT_BITS) % 2;
    let lists = TileList::SHADER_SIZE.get() * tiles;
    let stretches = counts.longest_list.div_ceil(crate::shader_layout::STRETCH.into()).max(1);
    let windows = frame.windows(counts);
    let splat = Ellipse::SHADER_SIZE.get() + Level::SHADER_SIZE.get();
    table.pass = Pass::TileLists;
    table.clear("large_items", WORD);
    for window in 0..windows {
        let pairs = counts.tile_pairs * (window + 1) / windows - counts.tile_pairs * window / windows;
        table.begin(Pass::TileLists);
        let totals = Resource::write("totals", 0, 0);
        if window == 0 {
            table.indirect(
                "touch",
                "dispatches",
                vec![
                    Resource::read("ellipses", Ellipse::SHADER_SIZE.get() * items),
                    depth_order(WORD * counts.listed),
                    totals,
                    Resource::write("touched", 0, WORD * items),
                    Resource::write("touched_sums", 0, blocks),
                    Resource::read("levels", Level::SHADER_SIZE.get() * items),
                    Resource::read("shown_before", 0),
                    Resource::write("large_items", 0, 0),
                ],
            );
            table.dispatch("sum_touched", vec![totals, Resource::write("touched_sums", blocks, blocks)]);
        }
        table.dispatch(
            "open_window",
            vec![
                totals,
                Resource::write("pair_dispatches", 0, 0),
                Resource::write("longest_list", 0, 0),
                Resource::write("large_items", 0, 0),
            ],
        );
        table.indirect(
            "list_pairs",
            "dispatches",
            vec![
                Resource::read("ellipses", Ellipse::SHADER_SIZE.get() * counts.splats / windows),
                depth_order(WORD * counts.listed),
                totals,
                Resource::write("touched", WORD * items, 0),
                Resource::write("touched_sums", blocks, 0),
                Resource::write("pair_tiles", 0, WORD * pairs).of("pair tiles", 0),
                Resource::write("pair_splats", 0, WORD * pairs).of("pair splats", 0),
                Resource::read("levels", Level::SHADER_SIZE.get() * counts.splats / windows),
                Resource::read("shown_before", 0),
            ],
        );
        // The pairs of large splats are among those of `list_pairs`.
        table.indirect(
            "list_large",
            "pair_dispatches",
            vec![
                Resource::read("ellipses", 0),
                depth_order(0),
                Resource::write("touched", 0, 0),
                Resource::write("touched_sums", 0, 0),
                Resource::write("pair_tiles", 0, 0).of("pair tiles", 0),
                Resource::write("pair_splats", 0, 0).of("pair splats", 0),
                Resource::read("levels", 0),
                Resource::read("shown_before", 0),
                Resource::write("large_items", 0, 0),
            ],
        );
        table.begin(Pass::PairSort);
        sort(table, ["pair tiles", "pair splats", "pair digits"], "pair_dispatches", (pairs, bits));
        table.begin(Pass::TileLists);
        table.dispatch("clear_lists", vec![Resource::write("tile_lists", 0, lists)]);
        table.indirect(
            "find_ends",
            "pair_dispatches",
            vec![
                totals,
                Resource::write("pair_tiles", WORD * pairs, 0).of("pair tiles", sorted),
                Resource::write("tile_lists", 0, lists),
            ],
        );
        table.dispatch("longest", vec![Resource::write("tile_lists", lists, 0), Resource::write("longest_list", 0, 0)]);
        table.begin(Pass::Blend);
        let kept = |count: u64| count / (windows * stretches);
        for stretch in 0..stretches {
            let is_last = window + 1 == windows && stretch + 1 == stretches;
            let between = |is_used: bool| if is_used { TILE_PIXEL * counts.samples } else { 0 };
            let stored = if is_last { frame.picture.bytes() * counts.pixels } else { 0 };
            let fronts = if frame.depths { WORD * counts.pixels } else { 0 };
            let read = kept(counts.visited);
            table.dispatch(
                if frame.staged { "blend_staged" } else { "blend" },
                vec![
                    Resource::read("ellipses", Ellipse::SHADER_SIZE.get() * read),
                    Resource::write("pair_splats", WORD * read, 0).of("pair splats", sorted),
                    Resource::write("tile_lists", lists, 0),
                    Resource::write("pixels", between(window + stretch > 0), between(!is_last)),
                    Resource::read("levels", (splat - Ellipse::SHADER_SIZE.get()) * read),
                    Resource::read("tints", Tint::SHADER_SIZE.get() * read),
                    Resource::read("near_rays", NearRay::SHADER_SIZE.get() * kept(counts.visited_by_rays)),
                    Resource::target("pictures", 0, 0, stored),
                    Resource::target("depths", 0, 0, fronts),
                ],
            );
        }
    }
}

/// Blending of quadrilaterals in so many bands: see `quads`.
fn quads(table: &mut Table, frame: &Frame, counts: &Counts, bands: u32) {
    let splat = |bytes: u64| bytes * counts.listed / u64::from(bands);
    let (views, pixels) = (counts.views as u32, counts.pixels / counts.views.max(1));
    let pixel = frame.target.bytes();
    let rejects = bands > 1;
    for band in 0..bands {
        for view in 0..if band > 0 { views } else { 0 } {
            table.full_screen(
                Pass::Blend,
                "close",
                pixels,
                vec![
                    Resource::sampled("blended", view, pixel * pixels),
                    Resource::target("reject", view, 0, REJECT_PIXEL * pixels),
                ],
            );
        }
        // With multiview one pass draws both.
        let passes = if frame.multiview { 1 } else { views };
        for view in 0..passes {
            let share = |count: u64| count / u64::from(bands * passes);
            let of_views = u64::from(views / passes);
            let cleared = if band == 0 { pixels * of_views } else { 0 };
            table.begin(Pass::Blend);
            let mut resources = vec![
                Resource::read("ellipses", splat(Ellipse::SHADER_SIZE.get()) * of_views),
                depth_order(splat(WORD)),
                Resource::read("levels", splat(Level::SHADER_SIZE.get()) * of_views),
                Resource::read("tints", splat(Tint::SHADER_SIZE.get()) * of_views),
                Resource::read("near_rays", NearRay::SHADER_SIZE.get() * share(counts.by_rays)),
                Resource::arguments("dispatches"),
                Resource::target(
                    "blended",
                    view,
                    pixel * share(counts.blended),
                    pixel * (share(counts.blended) + cleared),
                ),
            ];
            if rejects {
                let tested = REJECT_PIXEL * share(counts.fragments);
                resources.push(Resource::target("reject", view, tested, REJECT_PIXEL * cleared));
            }
            table.add("blend", Kind::DrawIndirect, resources).blended = share(counts.blended);
        }
    }
}

/// One picture for each view of quadrilaterals: see `compose`.
fn compose(table: &mut Table, frame: &Frame) {
    let pixels = frame.pixels();
    for view in 0..frame.views {
        let blended = Resource::sampled("blended", view, frame.target.bytes() * pixels);
        let picture = Resource::target("picture", view, 0, frame.picture.bytes() * pixels);
        table.full_screen(Pass::Compose, "from_quads", pixels, vec![blended, picture]);
    }
}

/// Depths of quadrilaterals: see `depth`. Tiles store theirs where they blend.
fn depths(table: &mut Table, frame: &Frame, counts: &Counts) {
    let pixels = frame.depth_pixels();
    let pixel = TargetFormat::Float32.bytes();
    let views = frame.views;
    for view in 0..views {
        let fragments = counts.depth_fragments / u64::from(views);
        table.begin(Pass::Depths);
        let command = table.add(
            "blend_depth",
            Kind::DrawIndirect,
            vec![
                Resource::read("ellipses", Ellipse::SHADER_SIZE.get() * counts.listed),
                depth_order(WORD * counts.listed),
                Resource::read("levels", Level::SHADER_SIZE.get() * counts.listed),
                Resource::read("tints", Tint::SHADER_SIZE.get() * counts.listed),
                Resource::read("near_rays", NearRay::SHADER_SIZE.get() * counts.by_rays / u64::from(views)),
                Resource::arguments("dispatches"),
                Resource::target("coarse", view, pixel * fragments, pixel * (fragments + pixels)),
            ],
        );
        command.blended = fragments;
    }
    for view in 0..views {
        let coarse = Resource::sampled("coarse", view, pixel * pixels);
        let depth = Resource::target("depth", view, 0, WORD * pixels);
        table.full_screen(Pass::Depths, "depth_from_quads", pixels, vec![coarse, depth]);
    }
}

/// Copies to the images of a window or a headset, and to the depth images of a headset: see `present` and `depth_layer`.
fn present(table: &mut Table, frame: &Frame) {
    let pixels = frame.pixels();
    for view in 0..frame.views {
        let picture = Resource::sampled("picture", view, frame.picture.bytes() * pixels);
        let image = Resource::target("image", view, 0, IMAGE_PIXEL * pixels);
        table.full_screen(Pass::Present, "present", pixels, vec![picture, image]);
    }
    for view in 0..if frame.depths { frame.views } else { 0 } {
        let depth = Resource::sampled("depth", view, WORD * frame.depth_pixels());
        let image = Resource::target("depth image", view, 0, WORD * pixels);
        table.full_screen(Pass::DepthLayer, "store", pixels, vec![depth, image]);
    }
}
