//! The log: frames of the firmware that is really built, as its encoder writes them.

use era::flash::image::default_path;
use era::monitor::{LogLine, LogTable, MonitorError};

/// rzCOBS, which defmt uses: seven bytes at a time, of which the zeros are left out, then a byte that says which were
/// zero; 0 ends a frame. (Longer runs without zeros have a shorter form, which these frames do not need.)
fn rzcobs(data: &[u8]) -> Vec<u8> {
    let mut padded = data.to_vec();
    padded.resize(data.len().next_multiple_of(7), 0);
    let mut out = Vec::new();
    for group in padded.chunks(7) {
        let mut zeros = 0_u8;
        for (bit, byte) in group.iter().enumerate() {
            if *byte == 0 {
                zeros |= 1 << bit;
            } else {
                out.push(*byte);
            }
        }
        // No zero at all: the next byte counts, and there may be more without zeros; 0x80 says seven.
        out.push(if zeros == 0 { 0x80 } else { zeros });
    }
    out.push(0);
    out
}

fn lines(table: &LogTable, pieces: &[&[u8]]) -> Vec<LogLine> {
    let (mut decoder, mut lines) = (table.decoder(), Vec::new());
    for piece in pieces {
        decoder.feed(piece, |line| lines.push(line));
    }
    lines
}

#[test]
fn the_built_firmwares_lines_are_readable() {
    let path = default_path();
    let Ok(elf) = std::fs::read(&path) else {
        eprintln!("skipped: {} is not there; cargo xtask firmware builds it", path.display());
        return;
    };
    let table = LogTable::from_elf(&elf).unwrap();
    let raw = defmt_decoder::Table::parse(&elf).unwrap().unwrap();
    // A line of the firmware's own source; its arguments, as far as it has any, are zero.
    let mut tried = 0;
    for index in raw.indices() {
        let Ok(index) = u16::try_from(index) else { continue };
        let mut frame = index.to_le_bytes().to_vec();
        frame.extend(61_500_000_u64.to_le_bytes());
        frame.extend([0; 40]);
        let Ok((expected, _)) = raw.decode(&frame) else { continue };
        if expected.level().is_none() {
            continue;
        }
        tried += 1;
        let bytes = rzcobs(&frame);
        let (head, tail) = bytes.split_at(5);
        // Cut anywhere, and after half a frame, which costs one line and no more.
        let found = lines(&table, &[b"\x55\x66\x00", head, tail]);
        let [.., line] = found.as_slice() else { panic!("no line") };
        assert_eq!(line.message, expected.display_message().to_string());
        assert_eq!(line.uptime_s.as_deref(), Some("61.500000"));
        assert_eq!(line.level, expected.level().map(|level| level.as_str()));
        assert!(line.place.as_ref().is_some_and(|place| place.contains(".rs:")), "{line:?}");
    }
    assert!(tried > 3, "only {tried} lines of the image could be tried");
}

#[test]
fn a_file_without_texts_is_refused() {
    assert!(matches!(LogTable::from_elf(b"nothing"), Err(MonitorError::NoTable(_))));
}

#[test]
fn a_line_is_aligned() {
    let line = LogLine {
        uptime_s: Some("1.000001".into()),
        level: Some("info"),
        message: "hello".into(),
        place: Some("src/main.rs:7".into()),
    };
    assert_eq!(line.to_string(), "    1.000001 info  hello  [src/main.rs:7]");
}
