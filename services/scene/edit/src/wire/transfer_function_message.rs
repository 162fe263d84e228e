//! Transfer functions as messages.

use std::sync::Arc;

use sg_proto::scene as proto;
use sg_reclassify::VolumeOfScene;
use sg_volume::TransferFunction;
use sg_volume::transfer::{ControlPoint, Scale, Units};

use super::{WireError, decode_color, encode_color};

/// Most control points.
const MAX_POINTS: usize = 1024;

const FIELD: &str = "transfer_function";

/// A transfer function as a message. The name of its quantity and its base units are left out.
#[must_use]
pub fn encode_transfer_function(function: &TransferFunction) -> proto::TransferFunction {
    let point = |point: &ControlPoint| proto::ControlPoint {
        value: point.value,
        color: Some(encode_color(point.color.into())),
        opacity: point.opacity,
    };
    let scale = match function.scale {
        Scale::Linear => proto::ValueScale::Linear,
        Scale::Log10 => proto::ValueScale::Log10,
        Scale::Symlog => proto::ValueScale::Symlog,
    };
    proto::TransferFunction {
        low: function.domain[0],
        high: function.domain[1],
        normalized: function.units == Units::Normalized,
        scale: scale.into(),
        points: function.points.iter().map(point).collect(),
    }
}

/// A transfer function from a message, checked.
///
/// # Errors
/// [`WireError`] names what is wrong with it.
pub fn decode_transfer_function(message: &proto::TransferFunction) -> Result<Arc<TransferFunction>, WireError> {
    let scale = decode_scale(message.scale)?;
    if message.points.len() > MAX_POINTS {
        let reason = format!("{} control points; give at most {MAX_POINTS}", message.points.len());
        return Err(WireError::TransferFunction { field: FIELD, reason });
    }
    let point = |point: &proto::ControlPoint| {
        let color = point.color.as_ref().ok_or(WireError::Missing("transfer_function.points.color"))?;
        // One form of zero: equal functions make no event, so they must be the same to the bit.
        let color = decode_color(color).to_array().map(|x| x + 0.0);
        Ok(ControlPoint { value: point.value + 0.0, color, opacity: point.opacity + 0.0 })
    };
    let function = TransferFunction {
        domain: [message.low, message.high].map(|x| x + 0.0),
        units: if message.normalized { Units::Normalized } else { Units::Raw },
        scale,
        variable: None,
        points: message.points.iter().map(point).collect::<Result<_, _>>()?,
        base_units: Vec::new(),
    };
    match function.check() {
        Ok(()) => Ok(Arc::new(function)),
        Err(problem) => Err(WireError::TransferFunction { field: FIELD, reason: problem.to_string() }),
    }
}

/// The volume behind a scene as a message.
pub(super) fn encode_volume(volume: &VolumeOfScene) -> proto::Volume {
    let [least, greatest] = volume.range;
    // No message may have more points; a file may.
    let function = volume.function.as_deref().filter(|function| function.points.len() <= MAX_POINTS);
    proto::Volume { function: function.map(encode_transfer_function), least, greatest }
}

/// The volume behind a scene from a message.
pub(super) fn decode_volume(message: &proto::Volume) -> Result<VolumeOfScene, WireError> {
    let function = message.function.as_ref().map(decode_transfer_function).transpose()?;
    Ok(VolumeOfScene { function, range: [message.least, message.greatest] })
}

/// The spacing of values from a message.
pub(crate) fn decode_scale(scale: i32) -> Result<Scale, WireError> {
    match proto::ValueScale::try_from(scale) {
        Ok(proto::ValueScale::Linear) => Ok(Scale::Linear),
        Ok(proto::ValueScale::Log10) => Ok(Scale::Log10),
        Ok(proto::ValueScale::Symlog) => Ok(Scale::Symlog),
        Ok(proto::ValueScale::Unspecified) | Err(_) => {
            Err(WireError::Kind { field: "transfer_function.scale", value: scale })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_round_trip_and_wrong_ones_are_named() {
        let point = |value, opacity| ControlPoint { value, color: [0.1, 0.5, 1.0], opacity };
        let function = TransferFunction {
            domain: [1.0, 1000.0],
            units: Units::Raw,
            scale: Scale::Log10,
            variable: None,
            points: vec![point(1.0, 0.0), point(10.0, 0.3), point(10.0, 0.7)],
            base_units: Vec::new(),
        };
        let message = encode_transfer_function(&function);
        assert_eq!(*decode_transfer_function(&message).unwrap(), function);
        let mut negative = encode_transfer_function(&TransferFunction { scale: Scale::Linear, ..function.clone() });
        (negative.low, negative.points[0].opacity) = (-0.0, -0.0);
        let zero = decode_transfer_function(&negative).unwrap();
        assert!(zero.domain[0].is_sign_positive() && zero.points[0].opacity.is_sign_positive());
        let spoiled = |spoil: &dyn Fn(&mut proto::TransferFunction)| {
            let mut message = message.clone();
            spoil(&mut message);
            decode_transfer_function(&message).unwrap_err().to_string()
        };
        assert!(spoiled(&|m| m.scale = 0).contains("transfer_function.scale"));
        assert!(spoiled(&|m| m.low = -1.0).contains("logarithm"));
        assert!(spoiled(&|m| m.points[1].color = None).contains("points.color"));
        assert!(spoiled(&|m| m.points[2].opacity = 2.0).contains("points[2]"));
        assert!(spoiled(&|m| m.points.clear()).contains("at least one"));
        assert!(spoiled(&|m| m.points = vec![m.points[0]; 1025]).contains("1024"));
    }
}
