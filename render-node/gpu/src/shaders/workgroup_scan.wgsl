// Sums over the lanes of one workgroup.

var<workgroup> scanned: array<u32, LANES>;

// Sum of the values of all lanes up to this one. All lanes must call it, with a barrier between two calls. The
// total is then in the last element of scanned.
fn sum_up_to(lane: u32, value: u32) -> u32 {
    scanned[lane] = value;
    workgroupBarrier();
    for (var step = 1u; step < LANES; step <<= 1u) {
        var more = 0u;
        if lane >= step {
            more = scanned[lane - step];
        }
        workgroupBarrier();
        scanned[lane] += more;
        workgroupBarrier();
    }
    return scanned[lane];
}

var<workgroup> scan_block: array<u32, SCAN_BLOCK>;

// Replaces the numbers of scan_block, which the lanes have just written, by `before` and the sum of all before them. Returns `before`
// and the sum of all. The lanes read and write a buffer's neighbouring numbers together, and each sums some of its own here: reading
// those from the buffer would take ten times as long.
fn sum_block_up_to(lane: u32, before: u32) -> u32 {
    const OWN = SCAN_BLOCK / LANES;
    workgroupBarrier();
    var sum = 0u;
    for (var k = 0u; k < OWN; k++) {
        sum += scan_block[lane * OWN + k];
    }
    var running = before + sum_up_to(lane, sum) - sum;
    for (var k = 0u; k < OWN; k++) {
        let own = scan_block[lane * OWN + k];
        scan_block[lane * OWN + k] = running;
        running += own;
    }
    workgroupBarrier();
    return before + scanned[LANES - 1u];
}
