// Gaussians across the planes of clips: the f32 twin of cut.rs. Axes are in units of the longest one.

// The kept part of a Gaussian.
struct Cut {
    position: vec3<f32>,
    // Columns of the root of the covariance.
    axes: mat3x3<f32>,
    // Share of the mass; 0 if nothing is kept.
    mass: f32,
}

// The complementary error function with a relative error of 1.2e-7 (Press et al. 1992, section 6.2).
fn complementary_error(x: f32) -> f32 {
    let z = abs(x);
    let t = 1.0 / (1.0 + 0.5 * z);
    var sum = 0.17087277;
    sum = -0.82215223 + t * sum;
    sum = 1.48851587 + t * sum;
    sum = -1.13520398 + t * sum;
    sum = 0.27886807 + t * sum;
    sum = -0.18628806 + t * sum;
    sum = 0.09678418 + t * sum;
    sum = 0.37409196 + t * sum;
    sum = 1.00002368 + t * sum;
    let value = t * exp(-z * z - 1.26551223 + t * sum);
    return select(2.0 - value, value, x >= 0.0);
}

// Distance of the center from a plane in standard deviations; a point is at an infinite one.
fn deviations(cut: Cut, normal: vec3<f32>, offset: f32, longest: f32) -> f32 {
    let distance = dot(normal, cut.position) - offset;
    let deviation = longest * length(normal * cut.axes);
    return clamp(distance, -1e30, 1e30) / max(deviation, 1e-30 * max(abs(distance), 1e-7));
}

fn by_plane(cut: Cut, normal: vec3<f32>, at: f32, longest: f32) -> Cut {
    // And what is not a number.
    if !(at < CUT_REACH) {
        return cut;
    }
    if at <= -CUT_REACH {
        return Cut(cut.position, cut.axes, 0.0);
    }
    let mass = 0.5 * complementary_error(-0.70710678 * at);
    let mean = 0.39894228 * exp(-0.5 * at * at) / mass;
    let narrowed = 1.0 - sqrt(max(1.0 - mean * (mean + at), 0.0));
    let across = normal * cut.axes;
    let axis = across / max(length(across), 1e-30);
    let along = cut.axes * axis;
    let axes = mat3x3(
        cut.axes[0] - narrowed * axis.x * along,
        cut.axes[1] - narrowed * axis.y * along,
        cut.axes[2] - narrowed * axis.z * along,
    );
    return Cut(cut.position + (mean * longest) * along, axes, cut.mass * mass);
}

fn cut_by_clips(position: vec3<f32>, axes: mat3x3<f32>, longest: f32) -> Cut {
    var cut = Cut(position, axes, 1.0);
    // Of the outside of a region: the side that the Gaussian is nearest to leaving, or farthest outside of.
    var least = 1e38;
    var normal = vec3(0.0);
    for (var k = 0u; k < frame.clip_side_count; k++) {
        let side = clip_sides[k];
        let at = deviations(cut, side.normal, side.offset, longest);
        if side.keep_inside == 1u {
            cut = by_plane(cut, side.normal, at, longest);
            continue;
        }
        if at < least {
            least = at;
            normal = side.normal;
        }
        if side.last == 1u {
            cut = by_plane(cut, -normal, -least, longest);
            least = 1e38;
        }
    }
    return cut;
}

// The area of a Gaussian that is seen along a direction, up to a constant.
fn seen_area(axes: mat3x3<f32>, direction: vec3<f32>) -> f32 {
    return length(vec3(
        dot(cross(axes[1], axes[2]), direction),
        dot(cross(axes[2], axes[0]), direction),
        dot(cross(axes[0], axes[1]), direction),
    ));
}

// The opacity of the kept part towards the eye: mass is optical depth times area.
fn cut_opacity(opacity: f32, before: mat3x3<f32>, cut: Cut, direction: vec3<f32>) -> f32 {
    if cut.mass >= 1.0 {
        return opacity;
    }
    let after = seen_area(cut.axes, direction);
    let factor = cut.mass * select(1.0, seen_area(before, direction) / after, after > 0.0);
    if opacity < 0.01 {
        // 1 - (1 - o)^f without its cancellation, to o^3.
        return opacity * factor * (1.0 - 0.5 * opacity * (factor - 1.0) * (1.0 - opacity * (factor - 2.0) / 3.0));
    }
    return 1.0 - pow(max(1.0 - opacity, 0.0), factor);
}
