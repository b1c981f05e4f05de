//! The data model of ISO/IEC 23090-31, and the events that it stands for.
//!
//! The reference software is what says how effects are meant: a keyframe of a transient band is a pulse; a vectorial wave is a vibration
//! whose amplitude is straight between keyframes, and constant before the first and after the last; a reference plays the library's effect at the
//! reference's own position.

use super::events::{EnvelopePoint, EventList, HapticEvent, find_mean_level, sharpness_from_hz};
use std::cell::Cell;

/// Most effects, those of references and composites counted each time.
const MAX_STEPS: usize = 10_000;
/// References inside each other.
const MAX_DEPTH: usize = 8;

/// What is told apart of a perception's kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BandKind {
    /// Keyframes are pulses.
    Transient,
    /// Keyframes are the motion itself.
    Curve,
    /// Keyframes are amplitude and frequency of a wave.
    VectorialWave,
    /// Coded samples.
    WaveletWave,
}

/// What an effect is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffectKind {
    /// Keyframes of its own.
    Basis,
    /// One of the library.
    Reference,
    /// Several effects.
    Composite,
}

/// A whole file.
#[derive(Clone, Debug, Default)]
pub struct MpegHaptics {
    /// Ticks per s.
    pub ticks_per_s: f64,
    /// What is felt.
    pub perceptions: Vec<MpegPerception>,
}

/// One sense of touch.
#[derive(Clone, Debug, Default)]
pub struct MpegPerception {
    /// Its number.
    pub id: i64,
    /// `Vibrotactile`, say.
    pub modality: String,
    /// What references play.
    pub library: Vec<MpegEffect>,
    /// Places on the body.
    pub channels: Vec<MpegChannel>,
}

/// One place on the body.
#[derive(Clone, Debug)]
pub struct MpegChannel {
    /// Its number.
    pub id: i64,
    /// What amplitudes are multiplied by.
    pub gain: f64,
    /// Its bands.
    pub bands: Vec<MpegBand>,
}

/// A band of frequencies.
#[derive(Clone, Debug)]
pub struct MpegBand {
    /// Its number; 0 in HJIF.
    pub id: i64,
    /// What its keyframes are.
    pub kind: BandKind,
    /// Lower and upper limit in Hz.
    pub limits_hz: (f64, f64),
    /// Its effects.
    pub effects: Vec<MpegEffect>,
}

/// An effect.
#[derive(Clone, Debug)]
pub struct MpegEffect {
    /// Its number, or that of the library's effect.
    pub id: i64,
    /// What it is.
    pub kind: EffectKind,
    /// In ticks.
    pub position: f64,
    /// By their positions.
    pub keyframes: Vec<Keyframe>,
    /// Of a composite effect.
    pub parts: Vec<MpegEffect>,
}

/// A keyframe.
#[derive(Clone, Copy, Debug, Default)]
pub struct Keyframe {
    /// From the effect's position in ticks.
    pub position: Option<f64>,
    /// -1 to 1.
    pub amplitude: Option<f64>,
    /// In Hz.
    pub frequency_hz: Option<f64>,
}

/// Adds what can be played of a file.
pub fn add_events_of_haptics(list: &mut EventList, haptics: &MpegHaptics) {
    let steps = Cell::new(0);
    let channels: usize = haptics.perceptions.iter().map(|perception| perception.channels.len()).sum();
    if channels > 1 {
        list.warn(format!("the file has {channels} channels: all are played at the touched place"));
    }
    for (p, perception) in haptics.perceptions.iter().enumerate() {
        let vibrates = ["vibrotactile", "vibration", "vibrotactile texture", "texture", "acceleration", "other"];
        if !vibrates.contains(&perception.modality.to_lowercase().as_str()) {
            list.warn(format!(
                "perceptions[{p}] is left out: its modality is {}, which is not a vibration",
                perception.modality
            ));
            continue;
        }
        for (c, channel) in perception.channels.iter().enumerate() {
            for (b, band) in channel.bands.iter().enumerate() {
                let name = format!("perceptions[{p}].channels[{c}].bands[{b}]");
                if band.kind == BandKind::WaveletWave {
                    list.warn(format!(
                        "{name} is left out: its effects are wavelets, which this program does not decode"
                    ));
                    continue;
                }
                if band.kind == BandKind::Curve {
                    list.warn(format!(
                        "{name} describes the motion over time (band_type Curve): the absolute value of the motion is \
                         used as the intensity"
                    ));
                }
                let scope = Scope { perception, channel, band, ticks_per_s: haptics.ticks_per_s, steps: &steps };
                for (e, effect) in band.effects.iter().enumerate() {
                    scope.add_effect(list, effect, effect.position, &format!("{name}.effects[{e}]"), 0);
                }
            }
        }
    }
}

/// Where an effect is.
struct Scope<'a> {
    perception: &'a MpegPerception,
    channel: &'a MpegChannel,
    band: &'a MpegBand,
    ticks_per_s: f64,
    steps: &'a Cell<usize>,
}

impl Scope<'_> {
    fn add_effect(&self, list: &mut EventList, effect: &MpegEffect, position: f64, name: &str, depth: usize) {
        if list.is_full() {
            return;
        }
        if depth > MAX_DEPTH {
            return list.warn(format!(
                "a part of {name} is left out, because it is nested more than {MAX_DEPTH} levels deep in references \
                 and composites"
            ));
        }
        self.steps.set(self.steps.get() + 1);
        if self.steps.get() > MAX_STEPS {
            return list.warn(format!("all effects after the first {MAX_STEPS} are left out"));
        }
        match effect.kind {
            EffectKind::Basis => self.add_keyframes(list, &effect.keyframes, position, name),
            EffectKind::Reference => {
                match self.perception.library.iter().find(|own| own.id == effect.id) {
                    // The library's own position does not count.
                    Some(own) => self.add_effect(list, own, position, name, depth + 1),
                    None => list.warn(format!(
                        "{name} is left out: the effect library of its perception has no \
                    effect `{}`",
                        effect.id
                    )),
                }
            }
            EffectKind::Composite => {
                for part in &effect.parts {
                    self.add_effect(list, part, position + part.position, name, depth + 1);
                }
            }
        }
    }

    fn add_keyframes(&self, list: &mut EventList, keyframes: &[Keyframe], position: f64, name: &str) {
        let strength = |amplitude: f64| (amplitude * self.channel.gain).abs();
        let time_s = position / self.ticks_per_s;
        let mut keyframes = keyframes.to_vec();
        keyframes.sort_by(|a, b| a.position.unwrap_or(0.0).total_cmp(&b.position.unwrap_or(0.0)));
        if self.band.kind == BandKind::Transient {
            for keyframe in keyframes {
                let Some(amplitude) = keyframe.amplitude else { continue };
                let at_s = (position + keyframe.position.unwrap_or(0.0)) / self.ticks_per_s;
                let sharpness = sharpness_from_hz(keyframe.frequency_hz.unwrap_or(self.middle_hz()));
                list.add_event_within_limits(name, HapticEvent::new_transient(at_s, strength(amplitude), sharpness));
            }
            return;
        }
        let point = |keyframe: &Keyframe, level: f64| EnvelopePoint {
            time_s: keyframe.position.unwrap_or(0.0) / self.ticks_per_s,
            level,
        };
        let mut is_above_full = false;
        let envelope: Vec<EnvelopePoint> = keyframes
            .iter()
            .filter_map(|keyframe| {
                let level = strength(keyframe.amplitude?);
                is_above_full |= level > 1.0;
                Some(point(keyframe, level.min(1.0)))
            })
            .collect();
        if is_above_full {
            list.warn(format!(
                "some amplitudes of {name} are above 1 after multiplication by the gain of the channel: \
                               the effect uses 1 instead"
            ));
        }
        let frequencies: Vec<EnvelopePoint> =
            keyframes.iter().filter_map(|keyframe| Some(point(keyframe, keyframe.frequency_hz?))).collect();
        let mean_hz = find_mean_level(&frequencies).unwrap_or_else(|| self.middle_hz());
        if frequencies.iter().any(|point| (point.level - mean_hz).abs() > 25.0) {
            list.warn(format!("the frequency of {name} changes over time: its mean {mean_hz:.0} Hz is used"));
        }
        let Some(last) = keyframes.last().and_then(|last| last.position).filter(|last| *last > 0.0) else {
            return list.warn(format!("{name} is left out: it has no keyframe with a position above 0"));
        };
        let span_s = (time_s, last / self.ticks_per_s);
        list.add_event_within_limits(
            name,
            HapticEvent::new_continuous(span_s, 1.0, sharpness_from_hz(mean_hz), envelope),
        );
    }

    fn middle_hz(&self) -> f64 {
        0.5 * (self.band.limits_hz.0 + self.band.limits_hz.1)
    }
}
