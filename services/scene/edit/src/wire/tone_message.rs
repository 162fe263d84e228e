//! Tones as messages.

use sg_proto::scene as proto;
use sg_scene::tone::Tone;

use super::WireError;

/// A tone as a message; absent where it changes nothing.
pub(super) fn encode_tone(tone: Tone) -> Option<proto::Tone> {
    let Tone { saturation, brightness, temperature } = tone;
    (!tone.is_neutral()).then_some(proto::Tone { saturation, brightness, temperature })
}

pub(super) fn decode_tone(tone: Option<&proto::Tone>, field: &'static str) -> Result<Tone, WireError> {
    let Some(proto::Tone { saturation, brightness, temperature }) = tone.copied() else { return Ok(Tone::NEUTRAL) };
    let fits = [saturation, brightness].iter().all(|factor| (0.0..=Tone::MOST).contains(factor))
        && (-1.0..=1.0).contains(&temperature);
    if fits { Ok(Tone { saturation, brightness, temperature }) } else { Err(WireError::Tone(field)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tones_come_back_and_numbers_out_of_range_are_refused() {
        let tone = Tone { saturation: 0.25, brightness: 4.0, temperature: -1.0 };
        assert_eq!(decode_tone(encode_tone(tone).as_ref(), "tone"), Ok(tone));
        assert_eq!((encode_tone(Tone::NEUTRAL), decode_tone(None, "tone")), (None, Ok(Tone::NEUTRAL)));
        let message = proto::Tone { saturation: 1.0, brightness: 1.0, temperature: 0.0 };
        for wrong in [
            proto::Tone { saturation: -0.1, ..message },
            proto::Tone { brightness: f32::NAN, ..message },
            proto::Tone { brightness: 4.1, ..message },
            proto::Tone { temperature: 1.5, ..message },
        ] {
            assert_eq!(decode_tone(Some(&wrong), "tone"), Err(WireError::Tone("tone")), "{wrong:?}");
        }
    }
}
