//! Arrays for NumPy, and their axes in files beside them.
//!
//! Version 1.0 of its format (numpy.lib.format): a magic number, a header padded so that the numbers begin at a multiple of 64
//! bytes, the numbers in C order, little-endian.

use era_files::{Readers, replace_file_by};
use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes an array, whole or not at all: `numpy_type` is NumPy's name of its type, as `<f8`, and `numbers` writes its bytes.
///
/// # Errors
/// That the file cannot be written.
pub fn write_npy_array(
    path: &Path,
    numpy_type: &str,
    shape: &[usize],
    numbers: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    // A tuple of one has a comma behind it; behind the last of several it is allowed.
    let mut header = format!("{{'descr': '{numpy_type}', 'fortran_order': False, 'shape': ({}), }}", sides.join(" "));
    // Magic number, version and length take 10 bytes, the line's end one.
    let length = (header.len() + 11).next_multiple_of(64) - 11;
    header = format!("{header:length$}\n");
    let length = u16::try_from(header.len()).map_err(io::Error::other)?.to_le_bytes();
    replace_file_by(path, Readers::ByUmask, |file| {
        file.write_all(b"\x93NUMPY\x01\x00")?;
        file.write_all(&length)?;
        file.write_all(header.as_bytes())?;
        numbers(file)
    })
}

/// Writes an array of doubles.
///
/// # Errors
/// As [`write_npy_array()`].
pub fn write_npy_doubles(path: &Path, shape: &[usize], numbers: impl Iterator<Item = f64>) -> io::Result<()> {
    write_npy_array(path, "<f8", shape, |file| {
        for number in numbers {
            file.write_all(&number.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Writes the axes of the array in `path` beside it, one file each.
///
/// # Errors
/// As [`write_npy_array()`].
pub fn write_npy_axis_files_beside_array(path: &Path, axes: &[(&str, &[f64])]) -> io::Result<()> {
    axes.iter().try_for_each(|(name, values)| {
        write_npy_doubles(&axis_file_path(path, name), &[values.len()], values.iter().copied())
    })
}

/// The file of an axis: `plate.x_m.npy` beside `plate.npy`.
#[must_use]
pub fn axis_file_path(path: &Path, axis: &str) -> PathBuf {
    let mut name = path.file_stem().map_or_else(OsString::new, OsString::from);
    name.push(format!(".{axis}.npy"));
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_those_of_the_format() {
        let folder = tempfile::tempdir().unwrap();
        for (shape, text) in [(&[3_usize][..], "(3,)"), (&[1, 3, 1], "(1, 3, 1,)")] {
            let path = folder.path().join("a.npy");
            write_npy_doubles(&path, shape, [1.0, -0.5, f64::NAN].into_iter()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
            assert!(header.contains(&format!("'shape': {text}, }}")) && header.ends_with('\n'), "{header}");
            assert_eq!((10 + length) % 64, 0);
            assert_eq!(bytes.len(), 10 + length + 24);
            assert_eq!(bytes[10 + length + 8..10 + length + 16], (-0.5_f64).to_le_bytes());
        }
    }

    #[test]
    fn axes_are_beside_their_array() {
        assert_eq!(axis_file_path(Path::new("a/plate.2.npy"), "x_m"), Path::new("a/plate.2.x_m.npy"));
        let folder = tempfile::tempdir().unwrap();
        write_npy_axis_files_beside_array(&folder.path().join("m.npy"), &[("x_m", &[0.0, 0.36]), ("y_m", &[0.1])])
            .unwrap();
        let x = std::fs::read(folder.path().join("m.x_m.npy")).unwrap();
        assert_eq!(x[x.len() - 8..], 0.36_f64.to_le_bytes());
        assert!(folder.path().join("m.y_m.npy").exists());
    }
}
