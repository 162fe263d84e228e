//! Placement of a scene in the room.

use glam::{DMat3, DQuat, DVec3};
use sg_scene::model::SceneBox;

/// Position and orientation of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Metres.
    pub position: DVec3,
    /// Of unit length.
    pub orientation: DQuat,
}

impl Pose {
    /// At the room's origin, looking along −z.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, orientation: DQuat::IDENTITY };

    /// The pose, if all of its numbers are finite and its orientation can be brought to unit length.
    #[must_use]
    pub fn checked(self) -> Option<Self> {
        let length = self.orientation.length();
        let sound = self.position.is_finite() && length.is_finite() && length > 1e-3;
        sound.then(|| Self { position: self.position, orientation: self.orientation.normalize() })
    }

    /// A point given in the axes of this pose, in the room.
    #[must_use]
    pub fn to_room(&self, point: DVec3) -> DVec3 {
        self.orientation * point + self.position
    }

    /// The direction it points in: its −z.
    #[must_use]
    pub fn forward(&self) -> DVec3 {
        self.orientation * DVec3::NEG_Z
    }
}

/// The origin of the room frame, at y = 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Origin {
    /// The floor.
    #[default]
    Floor,
    /// The eyes, where they were when the room was last centred.
    Eyes,
}

/// How a person uses the room.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stance {
    /// On their feet.
    #[default]
    Standing,
    /// On a chair.
    Seated,
}

impl Stance {
    /// Metres from y = 0 of the room to the middle of a fitted scene. Above the floor: 1.2 standing, 0.9 seated. Eyes are
    /// taken to be 1.6 and 1.2 above the floor.
    #[must_use]
    pub fn height(self, origin: Origin) -> f64 {
        match (self, origin) {
            (Self::Standing, Origin::Floor) => 1.2,
            (Self::Seated, Origin::Floor) => 0.9,
            (Self::Standing, Origin::Eyes) => 1.2 - 1.6,
            (Self::Seated, Origin::Eyes) => 0.9 - 1.2,
        }
    }
}

/// Metres ahead of the room's origin to the middle of a fitted scene.
pub(super) const AHEAD: f64 = 0.8;

/// A scene in the room: a similarity, room = `scale` · `rotation` · scene + `translation`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Placement {
    /// Metres of the room for one unit of the scene, above 0.
    pub scale: f64,
    /// Of unit length.
    pub rotation: DQuat,
    /// Metres.
    pub translation: DVec3,
}

impl Placement {
    /// One unit is a metre, and the origins are one.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Places the box in front of the person. Its longest edge is 1 m. Its middle is 0.8 m ahead of the room's origin, at
    /// [`Stance::height`]. The scene direction `up` points up, and `forward` points away from the person.
    ///
    /// An empty box counts as a unit cube. Zero or parallel directions count as z up and y forward.
    #[must_use]
    pub fn fit(bounds: SceneBox, up: DVec3, forward: DVec3, stance: Stance, origin: Origin) -> Self {
        let size = bounds.size().max_element();
        let scale = if size > 0.0 && size.is_finite() { 1.0 / size } else { 1.0 };
        let middle = 0.5 * (bounds.min + bounds.max);
        let middle = if middle.is_finite() { middle } else { DVec3::ZERO };
        let axes = |up: DVec3, forward: DVec3| {
            let up = up.try_normalize()?;
            let forward = forward.reject_from_normalized(up).try_normalize()?;
            Some(DMat3::from_cols(forward.cross(up), up, -forward))
        };
        let axes = axes(up, forward).or_else(|| axes(DVec3::Z, DVec3::Y)).unwrap_or_default();
        let rotation = DQuat::from_mat3(&axes.transpose()).normalize();
        let at = DVec3::new(0.0, stance.height(origin), -AHEAD);
        Self { scale, rotation, translation: at - scale * (rotation * middle) }
    }

    /// The placement, if it is one: finite, a scale above 0, the rotation brought to unit length.
    #[must_use]
    pub fn checked(self) -> Option<Self> {
        let turned = Pose { position: self.translation, orientation: self.rotation }.checked()?;
        let sound = self.scale.is_finite() && self.scale > 0.0;
        sound.then_some(Self { rotation: turned.orientation, ..self })
    }

    /// Transforms a scene point into the room.
    #[must_use]
    pub fn to_room(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// Transforms a room point into the scene.
    #[must_use]
    pub fn to_scene(&self, point: DVec3) -> DVec3 {
        self.rotation.inverse() * (point - self.translation) / self.scale
    }

    /// The scene turned about an axis of the room through `pivot`, in radians.
    #[must_use]
    pub fn turned(&self, pivot: DVec3, axis: DVec3, radians: f64) -> Self {
        let turn = DQuat::from_scaled_axis(axis.normalize_or_zero() * radians);
        Self {
            rotation: (turn * self.rotation).normalize(),
            translation: pivot + turn * (self.translation - pivot),
            ..*self
        }
    }

    /// The scene at another scale, the room's point `pivot` staying the same scene point.
    #[must_use]
    pub fn scaled(&self, pivot: DVec3, scale: f64) -> Self {
        let factor = scale / self.scale;
        Self { scale, translation: pivot + factor * (self.translation - pivot), ..*self }
    }
}
