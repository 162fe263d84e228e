// A sum over the lanes of one workgroup.

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
