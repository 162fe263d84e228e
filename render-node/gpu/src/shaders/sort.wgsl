// A stable radix sort of 32-bit keys with their values, four bits a pass: count, scan, scatter.
//
// Reduce, then scan: no workgroup waits for another within a pass. No device guarantees that two of them run at the
// same time. A look-back scan loses keys on a device that runs them one after another.

override COUNT: u32 = 0u;

const LANES: u32 = 256u;
const EACH: u32 = 16u;
const BLOCK: u32 = 4096u;
const DIGITS: u32 = 16u;

@group(0) @binding(0) var<uniform> shift: vec4<u32>;
@group(0) @binding(1) var<storage, read> totals: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_values: array<u32>;
// By digit, then by block.
@group(0) @binding(6) var<storage, read_write> counts: array<u32>;

fn blocks() -> u32 {
    return (totals[COUNT] + BLOCK - 1u) / BLOCK;
}

fn digit(key: u32) -> u32 {
    return (key >> shift.x) & (DIGITS - 1u);
}

var<workgroup> tally: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane < DIGITS {
        atomicStore(&tally[lane], 0u);
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let i = group.x * BLOCK + k * LANES + lane;
        if i < totals[COUNT] {
            atomicAdd(&tally[digit(keys[i])], 1u);
        }
    }
    workgroupBarrier();
    if lane < DIGITS {
        counts[lane * blocks() + group.x] = atomicLoad(&tally[lane]);
    }
}

@compute @workgroup_size(256)
fn scan(@builtin(local_invocation_index) lane: u32) {
    let n = DIGITS * blocks();
    let each = (n + LANES - 1u) / LANES;
    let first = lane * each;
    let last = min(first + each, n);
    var sum = 0u;
    for (var k = first; k < last; k++) {
        sum += counts[k];
    }
    var running = sum_up_to(lane, sum) - sum;
    for (var k = first; k < last; k++) {
        let count = counts[k];
        counts[k] = running;
        running += count;
    }
}

var<workgroup> sums: array<u32, LANES>;

// By digit, then by lane.
var<workgroup> places: array<u32, BLOCK>;

@compute @workgroup_size(256)
fn scatter(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var d = 0u; d < DIGITS; d++) {
        places[d * LANES + lane] = 0u;
    }
    // Each lane takes neighbouring keys, in order: that is what keeps the sort stable.
    let first = group.x * BLOCK + lane * EACH;
    let last = min(first + EACH, totals[COUNT]);
    for (var i = first; i < last; i++) {
        places[digit(keys[i]) * LANES + lane] += 1u;
    }
    workgroupBarrier();
    // Lane l sums sixteen neighbouring places, which are all of digit l / 16.
    var sum = 0u;
    for (var k = 0u; k < EACH; k++) {
        let place = lane * EACH + k;
        let count = places[place];
        places[place] = sum;
        sum += count;
    }
    sums[lane] = sum;
    workgroupBarrier();
    var start = counts[(lane / EACH) * blocks() + group.x];
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
