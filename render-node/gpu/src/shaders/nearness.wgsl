// Functions of many passes: Gaussians that rays evaluate. The f32 twin of nearness.rs and of the meetings in
// ray_consistent.rs.

// The share of a Gaussian that lies so many standard deviations beyond the near distance.
fn share_beyond(ahead: f32) -> f32 {
    let y = clamp(ahead * (0.5 / FADE_WIDTH) + 0.5, 0.0, 1.0);
    return y * y * y * (y * (6.0 * y - 15.0) + 10.0);
}

// Gaussians of the affine mode that rays evaluate.
struct NearRays {
    count: u32,
    entries: array<NearRay>,
}

struct Meeting {
    // log2 of the opacity over the alpha of a Gaussian that does not fade.
    below: f32,
    depth: f32,
    // Share beyond the near distance.
    share: f32,
}

// The point where a ray meets a Gaussian. `d` is the pixel relative to the stored one, `direction` the ray's x and y for z = 1.
fn meet_ray(ray: NearRay, d: vec2<f32>, direction: vec2<f32>, near: f32) -> Meeting {
    let a = ray.along.x + ray.along.y * d.x + ray.along.z * d.y;
    let u = ray.across.x + ray.across.y * d.x + ray.across.z * d.y;
    let v = ray.over.x + ray.over.y * d.y;
    let s = u * u + v * v;
    let whole = a * a + s;
    // The sign tells that it may fade.
    if ray.depth_factor >= 0.0 {
        if a > 0.0 {
            return Meeting(ray.fall * (s / whole), ray.depth_factor * (a / whole), 1.0);
        }
        return Meeting(ray.fall, 0.0, 1.0);
    }
    let depth = -ray.depth_factor * (a / whole);
    let n = near * inverseSqrt(1.0 + dot(direction, direction));
    // The standard deviation along the ray; |u| is the root of 2 ln 2 fall.
    let width = -ray.depth_factor * inverseSqrt(1.3862943611198906 * ray.fall * whole);
    let blur = NEAR_BLUR * n;
    let larger = max(max(width, blur), 1e-30);
    let ahead = (depth - n) / larger * inverseSqrt((width / larger) * (width / larger) + (blur / larger) * (blur / larger));
    return Meeting(ray.fall * (s / whole), max(depth, 0.0), share_beyond(ahead));
}

// Whether some ray may see less than all of a Gaussian of this size at this distance. What is not a number fades.
fn may_fade(distance: f32, size: f32, near: f32) -> bool {
    return !(distance >= (1.0 + NEAR_BLUR * FADE_WIDTH) * near + (FADE_REACH + FADE_WIDTH) * size);
}

// Whether no ray sees anything of a Gaussian of this size at this distance.
fn is_faded(distance: f32, size: f32, near: f32) -> bool {
    return distance + FADE_REACH * size + FADE_WIDTH * length(vec2(size, NEAR_BLUR * near)) <= near;
}

// How far the affine projection follows rays in its order and its dilation at a distance: 1 near the eye, 0 far away.
fn ray_share(distance: f32, near: f32) -> f32 {
    if distance >= RAY_ENDS * near {
        return 0.0;
    }
    return clamp(log(RAY_ENDS * near / distance) / log(RAY_ENDS / RAY_BEGINS), 0.0, 1.0);
}

// The number by which splats are ordered, from view z and the distance.
fn order_of(z: f32, distance: f32, near: f32) -> f32 {
    return z + ray_share(distance, near) * (distance - z);
}

// The slope at which the affine projection takes the dilation: 0 is that of 3DGS, that of the center that of rays. Outside the
// picture it is that of the picture's edge.
fn dilation_slope(view: View, slope: vec2<f32>, size: vec2<f32>, share: f32) -> vec2<f32> {
    let a = -view.principal / view.focal;
    let b = (size - view.principal) / view.focal;
    return sqrt(share) * clamp(slope, min(a, b), max(a, b));
}

// An unsigned number in the order of a number.
fn order_bits(order: f32) -> u32 {
    let bits = bitcast<u32>(order);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u);
}
