// A stable radix sort of 32-bit keys with their values, a few bits a pass: count, scan, scatter.
//
// Reduce, then scan: no workgroup waits for another within a pass. No device guarantees that two of them run at the
// same time. A look-back scan loses keys on a device that runs them one after another. The text before this one
// declares key_count.

const EACH: u32 = SORT_BLOCK / LANES;
const DIGITS: u32 = 1u << SORT_BITS;

@group(0) @binding(0) var<uniform> sort_pass: SortPass;
@group(0) @binding(1) var<storage, read> totals: Totals;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_values: array<u32>;
// By digit, then by block.
@group(0) @binding(6) var<storage, read_write> digit_counts: array<u32>;

fn blocks() -> u32 {
    return (key_count() + SORT_BLOCK - 1u) / SORT_BLOCK;
}

fn digit(key: u32) -> u32 {
    return (key >> sort_pass.shift) & (DIGITS - 1u);
}

var<workgroup> tally: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(LANES)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane < DIGITS {
        atomicStore(&tally[lane], 0u);
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let i = group.x * SORT_BLOCK + k * LANES + lane;
        if i < key_count() {
            atomicAdd(&tally[digit(keys[i])], 1u);
        }
    }
    workgroupBarrier();
    if lane < DIGITS {
        digit_counts[lane * blocks() + group.x] = atomicLoad(&tally[lane]);
    }
}

@compute @workgroup_size(LANES)
fn scan(@builtin(local_invocation_index) lane: u32) {
    let n = DIGITS * blocks();
    let each = (n + LANES - 1u) / LANES;
    let first = lane * each;
    let last = min(first + each, n);
    var sum = 0u;
    for (var k = first; k < last; k++) {
        sum += digit_counts[k];
    }
    var running = sum_up_to(lane, sum) - sum;
    for (var k = first; k < last; k++) {
        let count = digit_counts[k];
        digit_counts[k] = running;
        running += count;
    }
}

var<workgroup> sums: array<u32, LANES>;

// By digit, then by lane.
var<workgroup> places: array<u32, SORT_BLOCK>;

@compute @workgroup_size(LANES)
fn scatter(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var d = 0u; d < DIGITS; d++) {
        places[d * LANES + lane] = 0u;
    }
    // Each lane takes neighbouring keys, in order: that is what keeps the sort stable.
    let first = group.x * SORT_BLOCK + lane * EACH;
    let last = min(first + EACH, key_count());
    for (var i = first; i < last; i++) {
        places[digit(keys[i]) * LANES + lane] += 1u;
    }
    workgroupBarrier();
    // Lane l sums EACH neighbouring places, which are all of digit l / EACH.
    var sum = 0u;
    for (var k = 0u; k < EACH; k++) {
        let place = lane * EACH + k;
        let count = places[place];
        places[place] = sum;
        sum += count;
    }
    sums[lane] = sum;
    workgroupBarrier();
    var start = digit_counts[(lane / EACH) * blocks() + group.x];
    for (var k = lane & ~(EACH - 1u); k < lane; k++) {
        start += sums[k];
    }
    for (var k = 0u; k < EACH; k++) {
        places[lane * EACH + k] += start;
    }
    workgroupBarrier();
    for (var i = first; i < last; i++) {
        let key = keys[i];
        let place = digit(key) * LANES + lane;
        let to = places[place];
        places[place] = to + 1u;
        sorted_keys[to] = key;
        sorted_values[to] = values[i];
    }
}
