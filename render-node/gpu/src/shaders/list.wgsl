// From marked Gaussians to a list of them in index order, and how much work that makes for the passes after it.

override BLOCKS: u32 = 1u;
override PARTS: u32 = 1u;

const WORDS: u32 = 32u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> bits: array<u32>;
@group(0) @binding(3) var<storage, read_write> blocks: array<u32>;
// For each part: its first place in the list, and its length.
@group(0) @binding(4) var<storage, read_write> stretches: array<vec2<u32>>;
// Listed, marked, pairs in this window, pairs in all.
@group(0) @binding(5) var<storage, read_write> totals: array<u32>;
// Dispatches of the sort and of the tiles' lists, draws of all quadrilaterals and of each band of them, then a dispatch for
// each part.
@group(0) @binding(6) var<storage, read_write> dispatches: array<u32>;
@group(0) @binding(7) var<storage, read_write> listed: array<u32>;
@group(0) @binding(8) var<storage, read> parts: array<Part>;

// Workgroups for so many items; what is beyond the most that can be dispatched is a second item for some of them.
fn groups(items: u32, each: u32) -> u32 {
    return min((items + each - 1u) / each, 65535u);
}

@compute @workgroup_size(256)
fn sum_blocks(@builtin(local_invocation_index) lane: u32) {
    let each = (BLOCKS + 255u) / 256u;
    let first = lane * each;
    let last = min(first + each, BLOCKS);
    var sum = 0u;
    for (var k = first; k < last; k++) {
        sum += blocks[k];
    }
    var running = sum_up_to(lane, sum) - sum;
    for (var k = first; k < last; k++) {
        let count = blocks[k];
        blocks[k] = running;
        running += count;
    }
    storageBarrier();
    if lane == 0u {
        let marked = scanned[255];
        let count = min(marked, frame.capacity);
        totals[0] = count;
        totals[1] = marked;
        dispatches[0] = (count + 4095u) / 4096u;
        dispatches[1] = 1u;
        dispatches[2] = 1u;
        dispatches[3] = groups(count * frame.view_count, 256u);
        dispatches[4] = 1u;
        dispatches[5] = 1u;
        dispatches[6] = 4u;
        dispatches[7] = count;
        dispatches[8] = 0u;
        dispatches[9] = 0u;
        // Each band of quadrilaterals but the first is as long as all before it. Where it begins stands in its first vertex.
        for (var b = 0u; b < BANDS; b++) {
            let begin = select(count >> (BANDS - b), 0u, b == 0u);
            let at = 10u + 4u * b;
            dispatches[at] = 4u;
            dispatches[at + 1u] = (count >> (BANDS - 1u - b)) - begin;
            dispatches[at + 2u] = 4u * begin;
            dispatches[at + 3u] = 0u;
        }
        for (var p = 0u; p < PARTS; p++) {
            let begin = min(blocks[parts[p].block], count);
            var end = count;
            if p + 1u < PARTS {
                end = min(blocks[parts[p + 1u].block], count);
            }
            stretches[p] = vec2(begin, end - begin);
            let at = 10u + 4u * BANDS + 3u * p;
            dispatches[at] = groups(end - begin, 64u);
            dispatches[at + 1u] = 1u;
            dispatches[at + 2u] = 1u;
        }
    }
}

var<workgroup> held: array<u32, WORDS>;
var<workgroup> before: array<u32, WORDS>;

@compute @workgroup_size(256)
fn list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = part.block + group.x;
    if lane < WORDS {
        held[lane] = bits[block * WORDS + lane];
    }
    workgroupBarrier();
    if lane == 0u {
        var running = blocks[block];
        for (var k = 0u; k < WORDS; k++) {
            before[k] = running;
            running += countOneBits(held[k]);
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < 4u; k++) {
        let at = k * 256u + lane;
        let word = held[at >> 5u];
        let bit = 1u << (at & 31u);
        let to = before[at >> 5u] + countOneBits(word & (bit - 1u));
        if (word & bit) != 0u && to < frame.capacity {
            listed[to] = part.first + group.x * 1024u + at;
        }
    }
}
