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
    sum_numbers(lane, DIGITS * blocks());
}

// Counters of the digits d and d + HALF share a word: no lane counts beyond 2^16. By d, then by lane.
const HALF: u32 = DIGITS / 2u;
var<workgroup> places: array<u32, HALF * LANES>;

// Where the keys of a digit go, less their place in the block.
var<workgroup> digit_shifts: array<u32, DIGITS>;

// Keys or values of the block. A gap after each lane's own keeps lanes in step out of each other's bank.
var<workgroup> exchange: array<u32, SORT_BLOCK + LANES>;

fn gapped(i: u32) -> u32 {
    return i + i / EACH;
}

fn word_of(digit: u32, lane: u32) -> u32 {
    return (digit % HALF) * LANES + lane;
}

fn half_of(digit: u32) -> u32 {
    return 16u * (digit / HALF);
}

// The lanes read neighbouring keys together and exchange them, so that each has neighbours of its own: that is what keeps the sort
// stable. They put them in the order of their digits in workgroup memory, and write neighbours together again.
@compute @workgroup_size(LANES)
fn scatter(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let begin = group.x * SORT_BLOCK;
    let n = min(SORT_BLOCK, key_count() - begin);
    for (var k = 0u; k < EACH; k++) {
        let i = k * LANES + lane;
        if i < n {
            exchange[gapped(i)] = keys[begin + i];
        }
    }
    for (var d = 0u; d < HALF; d++) {
        places[d * LANES + lane] = 0u;
    }
    workgroupBarrier();
    var own: array<u32, EACH>;
    for (var k = 0u; k < EACH; k++) {
        let i = lane * EACH + k;
        if i < n {
            own[k] = exchange[gapped(i)];
            let d = digit(own[k]);
            places[word_of(d, lane)] += 1u << half_of(d);
        }
    }
    workgroupBarrier();
    // Each lane sums HALF neighbouring words. The upper halves follow all lower ones.
    var sum = 0u;
    for (var k = 0u; k < HALF; k++) {
        let count = places[lane * HALF + k];
        places[lane * HALF + k] = sum;
        sum += count;
    }
    let before = sum_up_to(lane, sum) - sum;
    let start = before + (scanned[LANES - 1u] << 16u);
    for (var k = 0u; k < HALF; k++) {
        places[lane * HALF + k] += start;
    }
    workgroupBarrier();
    if lane < DIGITS {
        let first = (places[word_of(lane, 0u)] >> half_of(lane)) & 0xffffu;
        digit_shifts[lane] = digit_counts[lane * blocks() + group.x] - first;
    }
    workgroupBarrier();
    var place: array<u32, EACH>;
    for (var k = 0u; k < EACH; k++) {
        if lane * EACH + k < n {
            let d = digit(own[k]);
            place[k] = gapped((places[word_of(d, lane)] >> half_of(d)) & 0xffffu);
            places[word_of(d, lane)] += 1u << half_of(d);
            exchange[place[k]] = own[k];
        }
    }
    workgroupBarrier();
    var to: array<u32, EACH>;
    for (var k = 0u; k < EACH; k++) {
        let i = k * LANES + lane;
        if i < n {
            let key = exchange[gapped(i)];
            to[k] = digit_shifts[digit(key)] + i;
            sorted_keys[to[k]] = key;
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let i = k * LANES + lane;
        if i < n {
            exchange[gapped(i)] = values[begin + i];
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        own[k] = exchange[gapped(lane * EACH + k)];
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        if lane * EACH + k < n {
            exchange[place[k]] = own[k];
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let i = k * LANES + lane;
        if i < n {
            sorted_values[to[k]] = exchange[gapped(i)];
        }
    }
}
