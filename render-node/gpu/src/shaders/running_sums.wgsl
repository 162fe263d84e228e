// Running sums of the buffer NUMBERS, by one workgroup. shader.rs puts the name of its variable here: a function cannot take a buffer.

var<workgroup> scan_block: array<u32, SCAN_BLOCK>;

// Replaces each of the first n numbers by the sum of those before it. Returns the sum of all. The lanes read and write neighbouring
// numbers together, and each sums some of its own in workgroup memory.
fn sum_numbers(lane: u32, n: u32) -> u32 {
    const OWN = SCAN_BLOCK / LANES;
    var before = 0u;
    for (var begin = 0u; begin < n; begin += SCAN_BLOCK) {
        for (var k = lane; k < SCAN_BLOCK; k += LANES) {
            scan_block[k] = 0u;
            if begin + k < n {
                scan_block[k] = NUMBERS[begin + k];
            }
        }
        workgroupBarrier();
        var sum = 0u;
        for (var k = 0u; k < OWN; k++) {
            sum += scan_block[lane * OWN + k];
        }
        var running = before + sum_up_to(lane, sum) - sum;
        before += scanned[LANES - 1u];
        for (var k = 0u; k < OWN; k++) {
            let own = scan_block[lane * OWN + k];
            scan_block[lane * OWN + k] = running;
            running += own;
        }
        workgroupBarrier();
        for (var k = lane; k < min(SCAN_BLOCK, n - begin); k += LANES) {
            NUMBERS[begin + k] = scan_block[k];
        }
        workgroupBarrier();
    }
    return before;
}
