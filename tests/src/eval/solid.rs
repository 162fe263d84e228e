//! Solids whose surfaces shapes are sampled from.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// A place on a surface.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Where.
    pub position: DVec3,
    /// Unit normal, outwards.
    pub normal: DVec3,
    /// Unit tangent along the solid's length; the same way for neighbours.
    pub tangent: DVec3,
    /// Radius of curvature across the tangent.
    pub bend: f64,
}

/// A rounded tube along a polyline, of a radius that changes linearly between its points.
#[derive(Debug, Clone)]
pub struct Tube {
    points: Vec<DVec3>,
    radii: Vec<f64>,
    /// One direction across the tube at each point, carried along without twist.
    across: Vec<DVec3>,
    /// Area up to the end of each piece: the pieces, then the two caps.
    area: Vec<f64>,
}

impl Tube {
    /// A tube through at least two distinct points.
    #[must_use]
    pub fn new(points: Vec<DVec3>, radius: impl Fn(f64) -> f64) -> Self {
        let last = points.len() - 1;
        let radii: Vec<f64> = (0..=last).map(|i| radius(i as f64 / last as f64)).collect();
        let mut across = Vec::with_capacity(points.len());
        let mut u = (points[1] - points[0]).normalize().any_orthonormal_vector();
        for i in 0..=last {
            let along = (points[(i + 1).min(last)] - points[i.saturating_sub(1)]).normalize();
            u = (u - along * u.dot(along)).normalize();
            across.push(u);
        }
        let mut area = Vec::new();
        let mut sum = 0.0;
        for i in 0..last {
            sum += PI * (radii[i] + radii[i + 1]) * points[i].distance(points[i + 1]);
            area.push(sum);
        }
        for end in [0, last] {
            sum += TAU * radii[end] * radii[end];
            area.push(sum);
        }
        Self { points, radii, across, area }
    }

    fn contains(&self, p: DVec3) -> bool {
        self.points.windows(2).zip(self.radii.windows(2)).any(|(ends, radii)| {
            let along = ends[1] - ends[0];
            let t = ((p - ends[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let radius = radii[0] + t * (radii[1] - radii[0]);
            p.distance_squared(ends[0] + t * along) < radius * radius
        })
    }

    fn sample(&self, r: &mut ChaCha8Rng) -> Sample {
        let last = self.points.len() - 1;
        let at = r.random_range(0.0..self.area[last + 1]);
        let piece = self.area.partition_point(|a| *a <= at).min(last + 1);
        if piece >= last {
            let (end, inner) = if piece == last { (0, 1) } else { (last, last - 1) };
            let out = (self.points[end] - self.points[inner]).normalize();
            let mut normal = direction(r);
            if normal.dot(out) < 0.0 {
                normal = -normal;
            }
            let tangent = (out - normal * out.dot(normal)).try_normalize().unwrap_or(self.across[end]);
            return Sample {
                position: self.points[end] + normal * self.radii[end],
                normal,
                tangent,
                bend: self.radii[end],
            };
        }
        let t = r.random_range(0.0..1.0);
        let angle = r.random_range(0.0..TAU);
        let (a, b) = (self.points[piece], self.points[piece + 1]);
        let along = (b - a).normalize();
        let u = self.across[piece].lerp(self.across[piece + 1], t);
        let u = (u - along * u.dot(along)).normalize();
        let normal = u * angle.cos() + along.cross(u) * angle.sin();
        let radius = self.radii[piece] + t * (self.radii[piece + 1] - self.radii[piece]);
        Sample { position: a.lerp(b, t) + normal * radius, normal, tangent: along, bend: radius }
    }
}

/// An ellipsoid.
#[derive(Debug, Clone)]
pub struct Ellipsoid {
    centre: DVec3,
    axes: DMat3,
    radii: DVec3,
}

impl Ellipsoid {
    /// An ellipsoid with its axes along those of the world.
    #[must_use]
    pub fn new(centre: DVec3, radii: DVec3) -> Self {
        Self { centre, axes: DMat3::IDENTITY, radii }
    }

    /// The same with its axes turned.
    #[must_use]
    pub fn turned(self, axes: DMat3) -> Self {
        Self { axes, ..self }
    }

    fn contains(&self, p: DVec3) -> bool {
        (self.axes.transpose() * (p - self.centre) / self.radii).length_squared() < 1.0
    }

    /// Thomsen's approximation of the surface area, within about a percent.
    fn area(&self) -> f64 {
        let p = 1.6075;
        let [a, b, c] = self.radii.to_array().map(|x| x.powf(p));
        4.0 * PI * ((a * b + a * c + b * c) / 3.0).powf(1.0 / p)
    }

    fn sample(&self, r: &mut ChaCha8Rng) -> Sample {
        let largest = 1.0 / self.radii.min_element();
        loop {
            let d = direction(r);
            let stretched = d / self.radii;
            // The area that a solid angle of the sphere becomes.
            if r.random_range(0.0..1.0) * largest > stretched.length() {
                continue;
            }
            let normal = self.axes * stretched.normalize();
            let along = self.axes.x_axis;
            let tangent =
                (along - normal * along.dot(normal)).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
            let position = self.centre + self.axes * (d * self.radii);
            return Sample { position, normal, tangent, bend: self.radii.min_element() };
        }
    }
}

/// The graph of a height over a square around the origin of the x-y plane. The space below it is inside.
#[derive(Debug, Clone, Copy)]
pub struct Sheet {
    /// Half the edge of the square.
    pub half: f64,
    /// Heights: a sum of three waves of this amplitude.
    pub amplitude: f64,
}

impl Sheet {
    /// Height over a place of the plane.
    #[must_use]
    pub fn height(&self, x: f64, y: f64) -> f64 {
        self.amplitude * ((3.1 * x + 0.4).sin() * (2.3 * y).cos() + 0.5 * (5.3 * y - 2.0 * x).sin())
    }

    fn slope(&self, x: f64, y: f64) -> (f64, f64) {
        let step = 1e-4;
        let along = |dx, dy| (self.height(x + dx, y + dy) - self.height(x - dx, y - dy)) / (2.0 * step);
        (along(step, 0.0), along(0.0, step))
    }

    fn sample(&self, r: &mut ChaCha8Rng) -> Sample {
        let (x, y) = (r.random_range(-self.half..self.half), r.random_range(-self.half..self.half));
        let (sx, sy) = self.slope(x, y);
        let normal = DVec3::new(-sx, -sy, 1.0).normalize();
        Sample {
            position: DVec3::new(x, y, self.height(x, y)),
            normal,
            tangent: DVec3::new(1.0, 0.0, sx).normalize(),
            bend: 0.3,
        }
    }
}

/// A solid.
#[derive(Debug, Clone)]
pub enum Solid {
    /// A tube.
    Tube(Tube),
    /// An ellipsoid.
    Ellipsoid(Ellipsoid),
    /// The space below a sheet.
    Sheet(Sheet),
}

impl Solid {
    /// Surface area.
    #[must_use]
    pub fn area(&self) -> f64 {
        match self {
            Self::Tube(t) => t.area[t.area.len() - 1],
            Self::Ellipsoid(e) => e.area(),
            Self::Sheet(s) => 4.0 * s.half * s.half,
        }
    }

    /// Whether a point lies inside.
    #[must_use]
    pub fn contains(&self, p: DVec3) -> bool {
        match self {
            Self::Tube(t) => t.contains(p),
            Self::Ellipsoid(e) => e.contains(p),
            Self::Sheet(s) => p.x.abs() < s.half && p.y.abs() < s.half && p.z < s.height(p.x, p.y),
        }
    }

    /// A random place on the surface.
    pub fn sample(&self, r: &mut ChaCha8Rng) -> Sample {
        match self {
            Self::Tube(t) => t.sample(r),
            Self::Ellipsoid(e) => e.sample(r),
            Self::Sheet(s) => s.sample(r),
        }
    }
}

/// A uniformly distributed unit vector.
pub fn direction(r: &mut ChaCha8Rng) -> DVec3 {
    let z = r.random_range(-1.0..1.0_f64);
    let angle = r.random_range(0.0..TAU);
    let ring = (1.0 - z * z).sqrt();
    DVec3::new(ring * angle.cos(), ring * angle.sin(), z)
}

/// A normally distributed number of unit variance (Box and Muller).
pub fn normal(r: &mut ChaCha8Rng) -> f64 {
    let u: f64 = r.random_range(f64::MIN_POSITIVE..1.0);
    (-2.0 * u.ln()).sqrt() * r.random_range(0.0..TAU).cos()
}
