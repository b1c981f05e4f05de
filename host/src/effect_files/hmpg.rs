//! HMPG: the packets of ISO/IEC 23090-31, as the reference software (`IOStream`) writes and reads them.
//!
//! A file is a row of units, each with packets: when it is, what perceptions, channels and bands there are, the effect library, and data, which are
//! effects of one band. What a packet has beyond what is needed here is not read, as every packet has its length. Checksums are not
//! looked at.

use super::bits::BitReader;
use super::error::ReadError;
use super::events::EventList;
use super::format::FileFormat;
use super::mpeg::{
    BandKind, EffectKind, Keyframe, MpegBand, MpegChannel, MpegEffect, MpegHaptics, MpegPerception,
    add_events_of_haptics,
};

/// Ticks per s until a packet says it.
const DEFAULT_TICKS_PER_S: f64 = 1000.0;
/// Bits of a unit's head: type, synchronisation, layer; its duration and length follow.
const UNIT_KIND_BITS: usize = 6 + 2 + 4;
/// Modalities by their numbers.
const MODALITIES: [&str; 14] = [
    "Other",
    "Pressure",
    "Acceleration",
    "Velocity",
    "Position",
    "Temperature",
    "Vibrotactile",
    "Water",
    "Wind",
    "Force",
    "Vibrotactile Texture",
    "Stiffness",
    "Friction",
    "Electrotactile",
];
/// Largest gain: it is coded between its negative and itself.
const MAX_GAIN: f64 = 10_000.0;
/// Effects inside each other in the library.
const MAX_DEPTH: usize = 8;

/// Reads a file.
///
/// # Errors
/// [`ReadError`] for what is not made of units, or ends within one.
pub fn read_hmpg_bytes(bytes: &[u8]) -> Result<EventList, ReadError> {
    let broken = |detail: &str| ReadError::Syntax { format: FileFormat::Hmpg, detail: detail.to_owned() };
    let mut list = EventList::new(FileFormat::Hmpg, None);
    let mut stream =
        Stream { haptics: MpegHaptics { ticks_per_s: DEFAULT_TICKS_PER_S, ..MpegHaptics::default() }, time: 0.0 };
    let mut file = BitReader::new(bytes);
    while !file.is_at_end() {
        let (duration, length) =
            read_unit_head(&mut file).ok_or_else(|| broken("the file ends within the header of a unit"))?;
        let unit = file.take_bytes(length).ok_or_else(|| broken("a unit is longer than the file"))?;
        let mut packets = BitReader::new(unit);
        while !packets.is_at_end() {
            let (kind, payload) = read_packet(&mut packets).ok_or_else(|| broken("a unit ends within a packet"))?;
            if stream.read_payload(kind, payload, &mut list).is_none() {
                list.warn(format!(
                    "a packet of type {kind} is left out: the packet is too short, has an unknown type or value, or refers to a \
                     perception, channel or band that no earlier packet describes"
                ));
            }
        }
        stream.time += duration;
    }
    add_events_of_haptics(&mut list, &stream.haptics);
    list.finish()
}

fn read_unit_head(file: &mut BitReader<'_>) -> Option<(f64, usize)> {
    file.skip_bits(UNIT_KIND_BITS)?;
    let duration = f64::from(file.read_bits(24)?);
    let length = usize::try_from(file.read_bits(32)?).ok()?;
    file.skip_bits(4)?;
    Some((duration, length))
}

fn read_packet<'a>(packets: &mut BitReader<'a>) -> Option<(u32, &'a [u8])> {
    let kind = packets.read_bits(6)?;
    let length = usize::try_from(packets.read_bits(17)?).ok()?;
    packets.skip_bits(1)?;
    Some((kind, packets.take_bytes(length)?))
}

/// What has been read.
struct Stream {
    haptics: MpegHaptics,
    /// In ticks.
    time: f64,
}

impl Stream {
    /// Reads what a packet carries; `None` if it is too short, or about what is not known.
    fn read_payload(&mut self, kind: u32, payload: &[u8], list: &mut EventList) -> Option<()> {
        let mut bits = BitReader::new(payload);
        match kind {
            0 => {
                self.time = 1e3 * f64::from(bits.read_bits(32)?) / self.haptics.ticks_per_s;
                Some(())
            }
            2 => self.read_perception(&mut bits),
            3 => self.read_channel(&mut bits),
            4 => self.read_band(&mut bits),
            5 => self.read_data(&mut bits),
            6 => self.read_library(&mut bits),
            11 => {
                self.time = f64::from(bits.read_bits(32)?);
                let ticks_per_s = bits.read_bits(32)?;
                if ticks_per_s == 0 {
                    list.warn("a timescale is 0, but must be 1 or more: the previous timescale is used");
                } else {
                    self.haptics.ticks_per_s = f64::from(ticks_per_s);
                }
                Some(())
            }
            // What the file says about itself, and checksums.
            1 | 7..=10 => Some(()),
            _ => None,
        }
    }

    fn find_perception(&mut self, id: u32) -> Option<&mut MpegPerception> {
        self.haptics.perceptions.iter_mut().find(|own| own.id == i64::from(id))
    }

    /// A unit of synchronisation describes again what is known.
    fn read_perception(&mut self, bits: &mut BitReader<'_>) -> Option<()> {
        let id = bits.read_bits(8)?;
        bits.skip_bits(8)?;
        bits.skip_text()?;
        let modality = usize::try_from(bits.read_bits(8)?).ok()?;
        let modality = (*MODALITIES.get(modality)?).to_owned();
        if let Some(known) = self.find_perception(id) {
            known.modality = modality;
        } else {
            self.haptics.perceptions.push(MpegPerception { id: id.into(), modality, ..MpegPerception::default() });
        }
        Some(())
    }

    fn read_channel(&mut self, bits: &mut BitReader<'_>) -> Option<()> {
        let (id, perception) = (bits.read_bits(16)?, bits.read_bits(8)?);
        bits.skip_bits(8)?;
        bits.skip_text()?;
        bits.skip_bits(8)?;
        // Its last digits are those of the code, whose steps are 5e-6.
        let gain = (bits.read_fraction(32, (-MAX_GAIN, MAX_GAIN))? * 1e4).round() / 1e4;
        let channels = &mut self.find_perception(perception)?.channels;
        match channels.iter_mut().find(|own| own.id == i64::from(id)) {
            Some(known) => known.gain = gain,
            None => channels.push(MpegChannel { id: id.into(), gain, bands: Vec::new() }),
        }
        Some(())
    }

    fn read_band(&mut self, bits: &mut BitReader<'_>) -> Option<()> {
        let (id, perception, channel) = (bits.read_bits(8)?, bits.read_bits(8)?, bits.read_bits(16)?);
        bits.skip_bits(8)?;
        let kind = match bits.read_bits(3)? {
            0 => BandKind::Transient,
            1 => BandKind::Curve,
            2 => BandKind::VectorialWave,
            3 => BandKind::WaveletWave,
            _ => return None,
        };
        match kind {
            BandKind::Curve => bits.skip_bits(4)?,
            BandKind::WaveletWave => bits.skip_bits(8)?,
            BandKind::Transient | BandKind::VectorialWave => {}
        }
        let limits_hz = (f64::from(bits.read_bits(16)?), f64::from(bits.read_bits(16)?));
        let channels = &mut self.find_perception(perception)?.channels;
        let bands = &mut channels.iter_mut().find(|own| own.id == i64::from(channel))?.bands;
        if !bands.iter().any(|own| own.id == i64::from(id)) {
            bands.push(MpegBand { id: id.into(), kind, limits_hz, effects: Vec::new() });
        }
        Some(())
    }

    fn read_library(&mut self, bits: &mut BitReader<'_>) -> Option<()> {
        let (perception, count) = (bits.read_bits(8)?, bits.read_bits(16)?);
        let mut library = Vec::new();
        for _ in 0..count {
            library.push(read_library_effect(bits, 0)?);
        }
        self.find_perception(perception)?.library = library;
        Some(())
    }

    fn read_data(&mut self, bits: &mut BitReader<'_>) -> Option<()> {
        bits.skip_bits(1)?;
        let (perception, channel, band) = (bits.read_bits(8)?, bits.read_bits(16)?, bits.read_bits(8)?);
        let count = bits.read_bits(16)?;
        let time = self.time;
        let channels = &mut self.find_perception(perception)?.channels;
        let bands = &mut channels.iter_mut().find(|own| own.id == i64::from(channel))?.bands;
        let band = bands.iter_mut().find(|own| own.id == i64::from(band))?;
        if band.kind == BandKind::WaveletWave {
            return Some(());
        }
        for _ in 0..count {
            let effect = read_effect(bits, band.kind, time)?;
            // An effect that goes on has its further keyframes in later packets.
            let is_basis = effect.kind == EffectKind::Basis;
            let known = if is_basis { band.effects.iter_mut().find(|own| own.id == effect.id) } else { None };
            match known {
                Some(known) => known.keyframes.extend(effect.keyframes),
                None => band.effects.push(effect),
            }
        }
        Some(())
    }
}

fn effect_kind_from_bits(value: u32) -> Option<EffectKind> {
    Some(match value {
        0 => EffectKind::Basis,
        1 => EffectKind::Reference,
        2 => EffectKind::Composite,
        _ => return None,
    })
}

/// What an effect means in words: one bit whether it is there, and 12 for it.
fn skip_meaning(bits: &mut BitReader<'_>) -> Option<()> {
    if bits.read_bits(1)? == 1 { bits.skip_bits(4 + 8) } else { Some(()) }
}

fn read_effect(bits: &mut BitReader<'_>, band: BandKind, time: f64) -> Option<MpegEffect> {
    let id = bits.read_bits(16)?.into();
    let kind = effect_kind_from_bits(bits.read_bits(2)?)?;
    #[expect(clippy::cast_precision_loss, reason = "25 bits")]
    let position = time + bits.read_signed_bits(25)? as f64;
    let mut effect = MpegEffect { id, kind, position, keyframes: Vec::new(), parts: Vec::new() };
    if kind != EffectKind::Basis {
        return Some(effect);
    }
    skip_meaning(bits)?;
    let count = bits.read_bits(16)?;
    if band == BandKind::VectorialWave {
        // Phase and form of the wave.
        bits.skip_bits(16 + 4)?;
    }
    for _ in 0..count {
        // Of a transient and of a curve the amplitude is always there, of a transient the frequency, too.
        let (has_amplitude, has_frequency) = match band {
            BandKind::VectorialWave => {
                let mask = bits.read_bits(2)?;
                (mask & 1 == 1, mask & 2 == 2)
            }
            other => (true, other == BandKind::Transient),
        };
        let amplitude = if has_amplitude { Some(bits.read_fraction(8, (-1.0, 1.0))?) } else { None };
        let position = Some(f64::from(bits.read_bits(16)?));
        let frequency_hz = if has_frequency { Some(f64::from(bits.read_bits(16)?)) } else { None };
        effect.keyframes.push(Keyframe { position, amplitude, frequency_hz });
    }
    Some(effect)
}

fn read_library_effect(bits: &mut BitReader<'_>, depth: usize) -> Option<MpegEffect> {
    if depth > MAX_DEPTH {
        return None;
    }
    let id = bits.read_bits(16)?.into();
    let kind = effect_kind_from_bits(bits.read_bits(2)?)?;
    skip_meaning(bits)?;
    let position = f64::from(bits.read_bits(25)?);
    if kind == EffectKind::Basis {
        bits.skip_bits(16 + 4)?;
    }
    let mut effect = MpegEffect { id, kind, position, keyframes: Vec::new(), parts: Vec::new() };
    for _ in 0..bits.read_bits(16)? {
        let mask = bits.read_bits(3)?;
        let position = if mask & 1 == 1 { Some(f64::from(bits.read_bits(16)?)) } else { None };
        let amplitude = if mask & 2 == 2 { Some(bits.read_fraction(8, (-1.0, 1.0))?) } else { None };
        let frequency_hz = if mask & 4 == 4 { Some(f64::from(bits.read_bits(16)?)) } else { None };
        effect.keyframes.push(Keyframe { position, amplitude, frequency_hz });
    }
    for _ in 0..bits.read_bits(16)? {
        effect.parts.push(read_library_effect(bits, depth + 1)?);
    }
    Some(effect)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::events::{EventKind, HapticEvent};

    /// Numbers with their counts of bits, filled up to whole bytes.
    fn pack(fields: &[(u64, usize)]) -> Vec<u8> {
        let bits: Vec<bool> =
            fields.iter().flat_map(|(value, count)| (0..*count).rev().map(move |bit| value >> bit & 1 == 1)).collect();
        bits.chunks(8)
            .map(|byte| byte.iter().enumerate().fold(0, |sum, (i, bit)| sum | u8::from(*bit) << (7 - i)))
            .collect()
    }

    fn packet(kind: u64, fields: &[(u64, usize)]) -> Vec<u8> {
        let payload = pack(fields);
        [pack(&[(kind, 6), (payload.len() as u64, 17), (0, 1)]), payload].concat()
    }

    fn unit(kind: u64, duration: u64, packets: &[Vec<u8>]) -> Vec<u8> {
        let body = packets.concat();
        [pack(&[(kind, 6), (0, 2), (0, 4), (duration, 24), (body.len() as u64, 32), (0, 4)]), body].concat()
    }

    /// A transient of amplitude 1 at 100 + 20 ticks and 182 Hz, and one of the library 200 ticks into the second unit.
    fn build_file_bytes() -> Vec<u8> {
        let timing = packet(11, &[(0, 32), (1000, 32), (0, 24), (0, 24), (0, 1)]);
        let perception = packet(2, &[(3, 8), (0, 8), (1, 8), (u64::from(b'x'), 8), (6, 8), (0, 8), (1, 16), (0, 1)]);
        // Gain 1: (1 + 10000) / 20000 of 2^32 - 1, rounded up.
        let gain = (10_001.0 / 20_000.0 * f64::from(u32::MAX)).round() as u64;
        let channel = packet(3, &[(5, 16), (3, 8), (0, 8), (0, 8), (255, 8), (gain, 32)]);
        let band = packet(4, &[(9, 8), (3, 8), (5, 16), (0, 8), (0, 3), (65, 16), (300, 16), (2, 16)]);
        let library = packet(
            6,
            &[
                (3, 8),
                (1, 16),
                (7, 16),
                (0, 2),
                (0, 1),
                (0, 25),
                (0, 16),
                (0, 4),
                (1, 16),
                (0b111, 3),
                (0, 16),
                (255, 8),
                (300, 16),
                (0, 16),
            ],
        );
        let first = packet(
            5,
            &[
                (0, 1),
                (3, 8),
                (5, 16),
                (9, 8),
                (1, 16),
                (1, 16),
                (0, 2),
                (100, 25),
                (0, 1),
                (1, 16),
                (255, 8),
                (20, 16),
                (182, 16),
            ],
        );
        let second = packet(5, &[(0, 1), (3, 8), (5, 16), (9, 8), (1, 16), (7, 16), (1, 2), (200, 25)]);
        [unit(0, 0, &[timing, perception, library, channel, band]), unit(1, 128, &[first]), unit(1, 128, &[second])]
            .concat()
    }

    #[test]
    fn packets_are_read_as_the_reference_software_writes_them() {
        let list = read_hmpg_bytes(&build_file_bytes()).unwrap();
        assert_eq!(list.warnings, Vec::<String>::new());
        let expected =
            [HapticEvent::new_transient(0.12, 1.0, 117.0 / 235.0), HapticEvent::new_transient(0.328, 1.0, 1.0)];
        assert_eq!(list.events.len(), 2);
        for (found, expected) in list.events.iter().zip(expected) {
            let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
            assert!(
                close(found.time_s, expected.time_s)
                    && close(found.intensity, expected.intensity)
                    && close(found.sharpness, expected.sharpness),
                "{found:?} {expected:?}"
            );
        }
    }

    /// What the reference software's writer (`IOStream::writeFile`, packets of 128 ms, commit 2de9ff19) makes of these effects of a channel with gain
    /// 0.5: transients at 100 (1 at 182 Hz, and -0.5 at 65 Hz 50 later) and 700 (0.25 at 300 Hz), a wave at 1000 (0.4, 0.8 at 200, 0.8 at 400, all
    /// at 100 Hz), and a curve at 2000 (0, 1 at 100, -1 at 300).
    const REFERENCE: &str = "\
        0000000000000009102c001e00000000000003e8000080000000000400400432303233044d61696e010a323032342d30352d303107627920\
        68616e64010008001c00000170060000007e80000000800c0036000000000163ff8001a2ff00068db8010000000000000000000003100018\
        00000000000008202580004010001801000000004000007d0000201000180200000000240000009000020400000800000001601400260000\
        00000000800080000640000ff8000005b005000008000000016014002680000000000080009ffffe400009f8019002080c00001800000000\
        000400000800000001601400260000000000008001000003c0000cf8000009600c000008000000000004000008000000019014002c000000\
        00800080018000068000080000764000000c800d000008000000000005000008000000019014002c80000000800080019ffff68000080000\
        7ca019000c8005000008000000019014002c80000000800080019fffee80000800007ca032000c800c000020000000000004000008000000\
        0140140022000000010000800200000500000bf8000005000008000000014014002280000001000080021ffffd00000ff803200500000800\
        0000014014002280000001000080021ffff5000008000960";

    #[test]
    fn a_file_of_the_reference_software_is_read_as_it_was_meant() {
        let digit = |at: usize| REFERENCE.get(at..at + 2).map(|pair| u8::from_str_radix(pair, 16).unwrap());
        let bytes: Vec<u8> = (0..REFERENCE.len()).step_by(2).map_while(digit).collect();
        let list = read_hmpg_bytes(&bytes).unwrap();
        // Amplitudes are coded in steps of 2/255, and cut off.
        let expected = [
            (0.1, 0.5, 117.0 / 235.0),
            (0.15, 0.25, 0.0),
            (0.7, 0.125, 1.0),
            (1.0, 1.0, 35.0 / 235.0),
            (2.0, 1.0, 0.0),
        ];
        assert_eq!(list.events.len(), expected.len());
        for (event, (time_s, intensity, sharpness)) in list.events.iter().zip(expected) {
            let close = |a: f64, b: f64| (a - b).abs() < 4e-3;
            assert!(
                close(event.time_s, time_s) && close(event.intensity, intensity) && close(event.sharpness, sharpness),
                "{event:?}"
            );
        }
        for (event, duration_s, levels) in [(3, 0.4, [0.2, 0.4, 0.4]), (4, 0.3, [0.0, 0.5, 0.5])] {
            let EventKind::Continuous { duration_s: found_s, envelope } = &list.events[event].kind else {
                panic!("{event}")
            };
            assert!((found_s - duration_s).abs() < 1e-9, "{found_s}");
            for (point, level) in envelope.iter().zip(levels) {
                assert!((point.level - level).abs() < 4e-3, "{envelope:?}");
            }
        }
    }

    #[test]
    fn whatever_is_cut_or_changed_does_not_panic() {
        let whole = build_file_bytes();
        for length in 0..whole.len() {
            let _ = read_hmpg_bytes(&whole[..length]);
        }
        for at in 0..whole.len() {
            for flip in [1, 0x80, 0xff] {
                let mut changed = whole.clone();
                changed[at] ^= flip;
                let _ = read_hmpg_bytes(&changed);
            }
        }
        assert!(
            read_hmpg_bytes(&whole[..3]).unwrap_err().to_string().contains("the file ends within the header of a unit")
        );
    }
}
