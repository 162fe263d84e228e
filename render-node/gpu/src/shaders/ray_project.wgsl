// Coefficients of a Gaussian along the rays of a view: the f32 twin of ray_consistent.rs, in units of the center's
// distance.
//
// The dilation is at least 0.083 px² (0.3 px² but for previews), so that |u| is at most focal / 0.28. f32 then leaves an
// error of some 1e-7 of that in d. Linear functions of the pixel, a, U and V, are stored at the pixel nearest to the ellipse's center. V does
// not change along a row and lies in the level and the tint. The ellipse covers at least all drawn pixels.

struct Seen {
    ellipse: Ellipse,
    // As in the level.
    per_row: f32,
    range: f32,
    depth: f32,
    opacity: f32,
    usable: bool,
    // As in the tint.
    over_per_row: f32,
    ray: RayCoefficients,
    // Whether rays evaluate it.
    by_rays: bool,
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

// A length whose square may leave f32.
fn length_of(v: vec3<f32>) -> f32 {
    let most = max(largest(v), 1e-25);
    return most * length(v / most);
}

// The share of the opacity that is left where the opacity keeps the area of a share of the dilation: compensation() of project.rs.
fn compensation(m0: vec3<f32>, m1: vec3<f32>, dilation: f32, kept: f32) -> f32 {
    let whole = cross(m0, m1);
    let area = dot(whole, whole);
    let spread = dot(m0, m0) + dot(m1, m1);
    let less = kept * dilation;
    return sqrt((area + less * (spread + less)) / (area + dilation * (spread + dilation)));
}

// A unit vector across a unit vector.
fn across_of(v: vec3<f32>) -> vec3<f32> {
    return normalize(select(vec3(0.0, v.z, -v.y), vec3(-v.z, 0.0, v.x), abs(v.x) > abs(v.y)));
}

// Of unit length, or the other where it has none.
fn unit_or(v: vec3<f32>, other: vec3<f32>) -> vec3<f32> {
    let most = largest(v);
    if !(most > 1e-30) {
        return other;
    }
    return normalize(v / most);
}

// A lower triangular matrix by rows: its entries below the diagonal are 10, 20, 21.
struct Lower {
    diagonal: vec3<f32>,
    below: vec3<f32>,
}

// L with LL^T = rows rows^T + root^2 I, by Gram and Schmidt on the rows with `root` at the end of each, which loses no thin
// Gaussian of any length.
fn cholesky(rows: array<vec3<f32>, 3>, root: f32) -> Lower {
    var l: Lower;
    l.diagonal.x = sqrt(dot(rows[0], rows[0]) + root * root);
    let q0 = rows[0] / l.diagonal.x;
    let e0 = root / l.diagonal.x;
    l.below.x = dot(q0, rows[1]);
    l.below.y = dot(q0, rows[2]);
    let r1 = rows[1] - l.below.x * q0;
    let e1 = vec2(-l.below.x * e0, root);
    let r2 = rows[2] - l.below.y * q0;
    let e2 = vec3(-l.below.y * e0, 0.0, root);
    l.diagonal.y = sqrt(dot(r1, r1) + dot(e1, e1));
    let q1 = r1 / l.diagonal.y;
    let f1 = e1 / l.diagonal.y;
    l.below.z = dot(q1, r2) + dot(f1, e2.xy);
    let s2 = r2 - l.below.z * q1;
    let g2 = e2 - l.below.z * vec3(f1, 0.0);
    l.diagonal.z = sqrt(dot(s2, s2) + dot(g2, g2));
    return l;
}

// L^-1 v.
fn solve(l: Lower, v: vec3<f32>) -> vec3<f32> {
    let x = v.x / l.diagonal.x;
    let y = (v.y - l.below.x * x) / l.diagonal.y;
    let z = (v.z - l.below.y * x - l.below.z * y) / l.diagonal.z;
    return vec3(x, y, z);
}

// The root of the trace of the covariance, for axes of which the longest is `longest`.
fn size_of(rows: array<vec3<f32>, 3>, longest: f32) -> f32 {
    return longest * sqrt(dot(rows[0], rows[0]) + dot(rows[1], rows[1]) + dot(rows[2], rows[2]));
}

// Directions of the rays through the picture's corners, in order around it.
fn corner_ray(view: View, corner: vec2<f32>) -> vec3<f32> {
    return vec3((corner * vec2<f32>(frame.size) - view.principal) / view.focal, 1.0);
}

// Inner normals of the four planes through the eye and the picture's edges.
fn edge_normal(view: View, k: u32) -> vec3<f32> {
    var corners = array(vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0));
    let normal = normalize(cross(corner_ray(view, corners[k]), corner_ray(view, corners[(k + 1u) % 4u])));
    return select(normal, -normal, dot(normal, corner_ray(view, vec2(0.5))) < 0.0);
}

// `perspective` is the share of the perspective within it: RaySplat::lessen in ray_consistent.rs.
fn seen_by_rays(view: View, at: vec3<f32>, given: array<vec3<f32>, 3>, longest: f32, opacity: f32, kept: f32, perspective: f32) -> Seen {
    var seen: Seen;
    seen.by_rays = true;
    let away = length_of(at);
    // An eye in the center has no unit. With this least one, the limit of the share below leaves axes of up to 1e9 their length.
    let distance = max(max(away, 1e-15 * min(longest, 1e9)), 1e-25);
    let c = at / distance;
    let share = min(longest / distance, 1e15);
    let rows = array(share * given[0], share * given[1], share * given[2]);
    let dilation = frame.dilation / abs(view.focal.x * view.focal.y);
    let root = sqrt(dilation);
    let size_here = length(vec2(size_of(given, longest), root * away));
    let fades = may_fade(away, size_here, frame.near);

    seen.opacity = opacity;
    if kept < 1.0 {
        let axis = unit_or(c, vec3(0.0, 0.0, 1.0));
        let e = across_of(axis);
        let f = cross(axis, e);
        let m0 = rows[0] * e.x + rows[1] * e.y + rows[2] * e.z;
        let m1 = rows[0] * f.x + rows[1] * f.y + rows[2] * f.z;
        seen.opacity *= compensation(m0, m1, dilation, kept);
    }
    seen.range = log2(max(seen.opacity / frame.least_alpha, frame.alpha_ratio));
    let l = cholesky(rows, root);
    let u = solve(l, c);
    let eye_squared = max(dot(u, u), 1e-30);

    // The ellipse of the level, exact where it lies in front of the eye's plane; what cancels in the conic of its outline is
    // taken out of it by hand. Elsewhere it is the whole picture.
    let size = vec2<f32>(frame.size);
    // rho^2 = 2 ln 2 range
    let square = 1.3862943611198906 * seen.range;
    let slope = c.xy / c.z;
    let z_variance = dot(rows[2], rows[2]) + dilation;
    let ahead = c.z * c.z - square * z_variance;
    var center = 0.5 * size;
    var tall = 1e12;
    var along = 1e12;
    var ellipse_slope = 0.0;
    var level_is_seen = true;
    let least = max(perspective, 1e-6);
    let lessened_eye = select(eye_squared, eye_squared / least, perspective < 1.0);
    if perspective < 1.0 && lessened_eye > square * 1.0001 {
        // RaySplat::lessened_reach: a conic with a focus at the center's pixel.
        let axis = unit_or(u, vec3(0.0, 0.0, 1.0));
        let dx = solve(l, vec3(1.0 / view.focal.x, 0.0, 0.0));
        let dy = solve(l, vec3(0.0, 1.0 / view.focal.y, 0.0));
        let first = unit_or(cross(axis, dx), across_of(axis));
        let second = cross(axis, first);
        let rooted = sqrt(least);
        let ux = rooted * dot(first, cross(axis, dx));
        let uy = rooted * dot(first, cross(axis, dy));
        let vy = rooted * dot(second, cross(axis, dy));
        let right = perspective * dot(axis, dx) / ux;
        let h = vec2(right, (perspective * dot(axis, dy) - uy * right) / vy);
        let steepness = sqrt(square / (lessened_eye - square));
        let eccentricity = steepness * length(h);
        if eccentricity < 0.99 {
            let along_h = unit_or(vec3(h, 0.0), vec3(1.0, 0.0, 0.0)).xy;
            let rest = 1.0 - eccentricity * eccentricity;
            let major = steepness * dot(axis, solve(l, vec3(slope, 1.0))) / rest;
            let y_a = major * along_h;
            let y_b = major * sqrt(rest) * vec2(-along_h.y, along_h.x);
            let a = vec2((y_a.x - uy * y_a.y / vy) / ux, y_a.y / vy);
            let b = vec2((y_b.x - uy * y_b.y / vy) / ux, y_b.y / vy);
            let over = length(vec2(a.y, b.y));
            center = slope * view.focal + view.principal + eccentricity * a;
            ellipse_slope = (a.x * a.y + b.x * b.y) / (over * over);
            along = abs(a.x * b.y - a.y * b.x) / over + 0.01;
            tall = over + 0.01;
            if !(is_finite(center.x) && is_finite(center.y) && is_finite(ellipse_slope) && is_finite(along) && is_finite(tall)) {
                center = 0.5 * size;
                tall = 1e12;
                along = 1e12;
                ellipse_slope = 0.0;
            }
        }
    } else if perspective >= 1.0 && eye_squared > square * 1.0001 {
        for (var k = 0u; k < 4u; k++) {
            let n = edge_normal(view, k);
            let axis = rows[0] * n.x + rows[1] * n.y + rows[2] * n.z;
            let outside = -dot(n, c);
            level_is_seen = level_is_seen && !(outside > 1.0001 * sqrt(square * (dot(axis, axis) + dilation)));
        }
        if ahead > 1e-3 * c.z * c.z {
            level_is_seen = level_is_seen && c.z > 0.0;
            let k = square / ahead;
            let x = rows[0] - slope.x * rows[2];
            let y = rows[1] - slope.y * rows[2];
            let shift = -k * (vec2(dot(x, rows[2]), dot(y, rows[2])) - dilation * slope) * view.focal;
            center = slope * view.focal + view.principal + shift;
            // Rows of seven numbers: three of the Gaussian, three of the dilation, the shift.
            let x0 = sqrt(k) * view.focal.x * x;
            let y0 = sqrt(k) * view.focal.y * y;
            let x1 = sqrt(k) * root * view.focal.x * vec3(1.0, 0.0, -slope.x);
            let y1 = sqrt(k) * root * view.focal.y * vec3(0.0, 1.0, -slope.y);
            let y_squared = dot(y0, y0) + dot(y1, y1) + shift.y * shift.y;
            ellipse_slope = (dot(x0, y0) + dot(x1, y1) + shift.x * shift.y) / y_squared;
            let left0 = x0 - ellipse_slope * y0;
            let left1 = x1 - ellipse_slope * y1;
            let left2 = shift.x - ellipse_slope * shift.y;
            along = sqrt(dot(left0, left0) + dot(left1, left1) + left2 * left2) + 0.01;
            tall = sqrt(y_squared) + 0.01;
            if !(is_finite(center.x) && is_finite(center.y) && is_finite(ellipse_slope) && is_finite(along) && is_finite(tall)) {
                center = 0.5 * size;
                tall = 1e12;
                along = 1e12;
                ellipse_slope = 0.0;
            }
        }
    }
    let reach = sqrt(seen.range);
    seen.ellipse = Ellipse(center, ellipse_slope, reach / along);
    seen.per_row = reach / tall;

    // Rays: w is linear in the pixel, and so are its part along u and the parts of its product with u across it.
    let told_at = clamp(center, vec2(0.0), size);
    var w = solve(l, vec3((told_at - view.principal) / view.focal, 1.0));
    var per_x = solve(l, vec3(1.0 / view.focal.x, 0.0, 0.0));
    var per_y = solve(l, vec3(0.0, 1.0 / view.focal.y, 0.0));
    // d does not depend on the length of w: take one that squares well.
    let scale = length(w) + size.x * length(per_x) + size.y * length(per_y);
    w /= scale;
    per_x /= scale;
    per_y /= scale;
    let toward = unit_or(u, vec3(0.0, 0.0, 1.0));
    let first = unit_or(cross(toward, per_x), across_of(toward));
    let second = cross(toward, first);
    let fall = min(0.72134752044448170 * lessened_eye, 1e30);
    seen.ray.along = vec3(dot(toward, w), dot(toward, per_x), dot(toward, per_y));
    if perspective < 1.0 {
        let off = told_at - (slope * view.focal + view.principal);
        let change = (perspective - 1.0) * vec2(seen.ray.along.y, seen.ray.along.z);
        seen.ray.along += vec3(dot(change, off), change);
    }
    let rooted = select(1.0, sqrt(least), perspective < 1.0);
    seen.ray.fall = fall;
    seen.ray.across =
        rooted * vec3(dot(first, cross(toward, w)), dot(first, cross(toward, per_x)), dot(first, cross(toward, per_y)));
    seen.ray.depth_factor = sqrt(eye_squared) / scale * distance * select(1.0, -1.0, fades);
    seen.depth = rooted * dot(second, cross(toward, w));
    seen.over_per_row = rooted * dot(second, cross(toward, per_y));
    seen.usable = level_is_seen && !is_faded(away, size_here, frame.near) && is_finite(seen.ray.along.x) && is_finite(seen.ray.along.y) && is_finite(seen.ray.along.z)
        && is_finite(seen.ray.across.x) && is_finite(seen.ray.across.y) && is_finite(seen.ray.across.z)
        && is_finite(seen.ray.depth_factor) && is_finite(seen.depth) && is_finite(seen.over_per_row)
        && is_finite(eye_squared);
    return seen;
}
