// From marked Gaussians to a list of them in index order, and how much work that makes for the passes after it.

override BLOCKS: u32 = 1u;
override PARTS: u32 = 1u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> marked: array<u32>;
// Number of marked Gaussians in each block, then the sums before each block.
@group(0) @binding(3) var<storage, read_write> block_counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> part_ranges: array<PartRange>;
@group(0) @binding(5) var<storage, read_write> totals: Totals;
@group(0) @binding(6) var<storage, read_write> dispatches: Dispatches;
@group(0) @binding(7) var<storage, read_write> part_dispatches: array<DispatchArguments>;
@group(0) @binding(8) var<storage, read_write> listed: array<u32>;
@group(0) @binding(9) var<storage, read> parts: array<Part>;

// Workgroups for so many items; what is beyond the most that can be dispatched is a second item for some of them.
fn groups(items: u32, each: u32) -> DispatchArguments {
    return DispatchArguments(min((items + each - 1u) / each, 65535u), 1u, 1u);
}

@compute @workgroup_size(LANES)
fn sum_blocks(@builtin(local_invocation_index) lane: u32) {
    let marked_in_all = sum_numbers(lane, BLOCKS);
    storageBarrier();
    if lane == 0u {
        let count = min(marked_in_all, frame.capacity);
        totals.listed = count;
        totals.marked = marked_in_all;
        dispatches.depth_sort = DispatchArguments((count + SORT_BLOCK - 1u) / SORT_BLOCK, 1u, 1u);
        dispatches.tile_lists = groups(count * frame.view_count, LANES);
        dispatches.all_quads = DrawArguments(4u, count, 0u, 0u);
        // Each band of quadrilaterals but the first is as long as all before it. Where it begins stands in its first vertex.
        for (var b = 0u; b < BANDS; b++) {
            let begin = select(count >> (BANDS - b), 0u, b == 0u);
            dispatches.bands[b] = DrawArguments(4u, (count >> (BANDS - 1u - b)) - begin, 4u * begin, 0u);
        }
        for (var p = 0u; p < PARTS; p++) {
            let begin = min(block_counts[parts[p].first_block], count);
            var end = count;
            if p + 1u < PARTS {
                end = min(block_counts[parts[p + 1u].first_block], count);
            }
            part_ranges[p] = PartRange(begin, end - begin);
            part_dispatches[p] = groups(end - begin, PROJECT_LANES);
        }
    }
}

var<workgroup> held: array<u32, MARK_WORDS>;
var<workgroup> before: array<u32, MARK_WORDS>;

@compute @workgroup_size(LANES)
fn list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = part.first_block + group.x;
    if lane < MARK_WORDS {
        held[lane] = marked[block * MARK_WORDS + lane];
    }
    workgroupBarrier();
    if lane == 0u {
        var running = block_counts[block];
        for (var k = 0u; k < MARK_WORDS; k++) {
            before[k] = running;
            running += countOneBits(held[k]);
        }
    }
    workgroupBarrier();
    for (var at = lane; at < BLOCK; at += LANES) {
        let word = held[at >> 5u];
        let bit = 1u << (at & 31u);
        let to = before[at >> 5u] + countOneBits(word & (bit - 1u));
        if (word & bit) != 0u && to < frame.capacity {
            listed[to] = part.first + group.x * BLOCK + at;
        }
    }
}
