//! Edits of saturation, brightness and temperature.

use sg_input::number_format::decimals;
use sg_proto::scene::SetTone;
use sg_scene::tone::Tone;

use super::derived::Attribute;
use super::error::EditError;
use super::state::UnitRef;
use super::transaction::Transaction;

/// What a command asks for: absent parts stay.
#[derive(Debug, Clone, Copy)]
struct Wish {
    saturation: Option<f32>,
    brightness: Option<f32>,
    temperature: Option<f32>,
    relative: bool,
}

impl Wish {
    fn of(command: &SetTone) -> Result<Self, EditError> {
        let SetTone { saturation, brightness, temperature, relative, .. } = *command;
        if saturation.is_none() && brightness.is_none() && temperature.is_none() {
            let reason = "nothing is set; give a saturation, a brightness or a temperature".to_owned();
            return Err(EditError::Malformed { field: "set_tone", reason });
        }
        let within = |value: Option<f32>, least: f32, most: f32, field, want| match value {
            Some(found) if !found.is_finite() => Err(EditError::NotFinite { field, found: found.into() }),
            Some(found) if !(least..=most).contains(&found) => {
                Err(EditError::OutOfRange { field, found: found.into(), want })
            }
            // Minus zero is zero: the two must not be different states.
            value => Ok(value.map(|found| found + 0.0)),
        };
        const FACTOR: &str = "a factor from 0 to 4";
        Ok(Self {
            saturation: within(saturation, 0.0, Tone::MOST, "set_tone.saturation", FACTOR)?,
            brightness: within(brightness, 0.0, Tone::MOST, "set_tone.brightness", FACTOR)?,
            temperature: within(temperature, -1.0, 1.0, "set_tone.temperature", "from -1 (blue) to 1 (red)")?,
            relative,
        })
    }

    fn on(self, present: Tone) -> Tone {
        if self.relative {
            let by = Tone {
                saturation: self.saturation.unwrap_or(1.0),
                brightness: self.brightness.unwrap_or(1.0),
                temperature: self.temperature.unwrap_or(0.0),
            };
            return present.and(by);
        }
        Tone {
            saturation: self.saturation.unwrap_or(present.saturation),
            brightness: self.brightness.unwrap_or(present.brightness),
            temperature: self.temperature.unwrap_or(present.temperature),
        }
    }

    /// The attributes that it sets, whatever they were before.
    fn overridden(self) -> impl Iterator<Item = Attribute> {
        let set = [
            (Attribute::Saturation, self.saturation),
            (Attribute::Brightness, self.brightness),
            (Attribute::Temperature, self.temperature),
        ];
        set.into_iter().filter(move |(_, value)| value.is_some() && !self.relative).map(|(attribute, _)| attribute)
    }

    /// The change in words, behind the target.
    fn words(self) -> String {
        let percent = |value: f32| decimals(100.0 * f64::from(value), 2);
        let by = if self.relative { "by" } else { "to" };
        let factor = |name: &str, value: Option<f32>| value.map(|v| format!("{name} {by} {} %", percent(v)));
        let temperature = self.temperature.map(|t| format!("temperature {by} {}", decimals(f64::from(t), 2)));
        let parts = [factor("saturation", self.saturation), factor("brightness", self.brightness), temperature];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

impl Transaction<'_> {
    pub(super) fn set_tone(&mut self, command: &SetTone) -> Result<String, EditError> {
        let wish = Wish::of(command)?;
        let target = self.state.resolve(command.target.as_ref())?;
        self.refuse_locked(&target)?;
        for unit in self.base_and_named(&target) {
            match unit {
                UnitRef::Base(i) => {
                    if let Some(base) = self.state.base.get_mut(i) {
                        base.tone = wish.on(base.tone);
                    }
                }
                UnitRef::Editable(id) => self.with_unit(id, |unit| unit.tone = wish.on(unit.tone)),
            }
        }
        for attribute in wish.overridden() {
            self.supersede_named(attribute, &target)?;
        }
        let mut made = None;
        if let Some(members) = &target.unnamed {
            let here = self.derived_of(members, false);
            for attribute in wish.overridden() {
                self.supersede(attribute, members, here)?;
            }
            let id = self.derived_or_new(here, members, &target)?;
            self.with_unit(id, |unit| unit.tone = wish.on(unit.tone));
            made = Some(id);
        }
        self.focus_after(&target, made);
        Ok(format!("{} of {}", wish.words(), target.phrase))
    }
}
