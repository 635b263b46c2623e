//! The text of a user's calibration file, and the kind of a file without text.

use std::path::Path;

use crate::toml_file::FileError;

/// The formats that `farfield calibrate convert` and `farfield import` read; all are text.
pub const FORMATS_READ: &str = "farfield (TOML of aniposelib and Pose2Sim), freemocap, caliscope, opencv-yaml, opencv-json, \
     qualisys, theia, easymocap, vicon, colmap, kalibr";

/// The kind of a file, and how to convert its cameras to text.
struct Kind {
    /// With its article: "a Python pickle".
    what: &'static str,
    export: Export,
}

/// How to export cameras from a file.
enum Export {
    /// Python statements that write them as JSON; `IN` and `OUT` stand for the files.
    Python(&'static str),
    /// A sentence.
    Words(&'static str),
}

const FROM_PROGRAM: Export =
    Export::Words("export the cameras as text from the program that wrote it");
const UNPACK: Export = Export::Words("unpack it and give the calibration in it");
const NOT_CAMERAS: Export = Export::Words("give the file that holds the cameras");

const PICKLE: Kind = Kind {
    what: "a Python pickle",
    export: Export::Python(
        "import json, pickle\n\
         cameras = pickle.load(open(IN, \"rb\"))\n\
         json.dump(cameras, open(OUT, \"w\"), default=lambda it: it.tolist())",
    ),
};
const NPZ: Kind = Kind {
    what: "an archive of NumPy arrays",
    export: Export::Python(
        "import json, numpy\n\
         cameras = numpy.load(IN, allow_pickle=True)\n\
         json.dump(dict(cameras), open(OUT, \"w\"), default=lambda it: it.tolist())",
    ),
};
const NPY: Kind = Kind {
    what: "a NumPy array",
    export: Export::Python(
        "import json, numpy\n\
         cameras = numpy.load(IN, allow_pickle=True).tolist()\n\
         json.dump(cameras, open(OUT, \"w\"), default=lambda it: it.tolist())",
    ),
};
const MAT: Kind = Kind {
    what: "a MATLAB file",
    export: Export::Words(
        "write it as JSON in MATLAB: writelines(jsonencode(load('IN')), 'OUT'); `camera_matrix`, `distortion`, \
         `image_size`, `rotation`, `translation` are read by name",
    ),
};

/// The text of a file: UTF-8, UTF-16 with byte order mark, or Latin-1.
///
/// # Errors
/// [`FileError`] with the kind of the file by its content, how to convert its cameras to text, and
/// the supported formats.
pub fn text_of(bytes: Vec<u8>, path: &Path) -> Result<String, FileError> {
    let found = match String::from_utf8(bytes) {
        Ok(text) if is_ascii_pickle(&text) => Err(PICKLE),
        Ok(text) if !text.contains('\0') => Ok(text),
        Ok(text) => utf_16_or_latin_1(text.as_bytes()).ok_or_else(|| kind_of(text.as_bytes())),
        Err(error) => {
            let bytes = error.as_bytes();
            utf_16_or_latin_1(bytes).ok_or_else(|| kind_of(bytes))
        }
    };
    found.map_err(|kind| kind.refused(path))
}

/// Pickles of the first protocol are text.
fn is_ascii_pickle(text: &str) -> bool {
    ["(dp", "(lp", "cnumpy", "ccopy_reg"]
        .iter()
        .any(|begin| text.starts_with(begin))
}

/// Text in other encodings; `None` if the bytes are not text.
fn utf_16_or_latin_1(bytes: &[u8]) -> Option<String> {
    let units = |read: fn([u8; 2]) -> u16| -> Vec<u16> {
        let pairs = bytes.chunks_exact(2).skip(1);
        pairs.map(|pair| read([pair[0], pair[1]])).collect()
    };
    match bytes {
        [0xff, 0xfe, ..] => String::from_utf16(&units(u16::from_le_bytes)).ok(),
        [0xfe, 0xff, ..] => String::from_utf16(&units(u16::from_be_bytes)).ok(),
        _ => {
            let is_text =
                |byte: &u8| *byte >= b' ' && *byte != 0x7f || b"\t\n\r\x0c".contains(byte);
            let is_latin = bytes.iter().all(is_text);
            is_latin.then(|| bytes.iter().map(|byte| char::from(*byte)).collect())
        }
    }
}

/// The kind of binary content, by its first bytes.
fn kind_of(bytes: &[u8]) -> Kind {
    let named = |what, export| Kind { what, export };
    let has = |part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
    match bytes {
        [0x80, 2..=5, ..] => PICKLE,
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => NPY,
        [b'P', b'K', 3 | 5, 4 | 6, ..] => match () {
            () if has(b".npy") => NPZ,
            () if has(b"xl/") => named("an Excel workbook", FROM_PROGRAM),
            () => named("a ZIP archive", UNPACK),
        },
        _ if bytes.starts_with(b"MATLAB ") => MAT,
        _ if bytes.starts_with(b"\x89HDF\r\n\x1a\n") => {
            named("an HDF5 file (MATLAB 7.3 writes these, too)", FROM_PROGRAM)
        }
        _ if bytes.starts_with(b"\xd0\xcf\x11\xe0") => {
            named("an old Office document", FROM_PROGRAM)
        }
        _ if bytes.starts_with(b"SQLite format 3\0") => named("an SQLite database", FROM_PROGRAM),
        _ if bytes.starts_with(b"bplist") => named("a binary property list", FROM_PROGRAM),
        [0x1f, 0x8b, ..] => named("a gzip archive", UNPACK),
        _ if [
            &b"BZh"[..],
            b"\xfd7zXZ\0",
            b"7z\xbc\xaf",
            b"Rar!",
            b"\x28\xb5\x2f\xfd",
        ]
        .iter()
        .any(|it| bytes.starts_with(it)) =>
        {
            named("a packed archive", UNPACK)
        }
        _ if bytes.get(4..8) == Some(b"ftyp")
            || bytes.starts_with(b"RIFF")
            || bytes.starts_with(b"\x1a\x45\xdf\xa3") =>
        {
            named("a video", NOT_CAMERAS)
        }
        _ if bytes.starts_with(b"\x89PNG") || bytes.starts_with(b"\xff\xd8\xff") => {
            named("a picture", NOT_CAMERAS)
        }
        _ if bytes.starts_with(b"%PDF") => named("a PDF", NOT_CAMERAS),
        [_, 0x50, ..] if bytes.len() >= 512 => named("a C3D file", NOT_CAMERAS),
        _ => named("binary", FROM_PROGRAM),
    }
}

impl Kind {
    fn refused(&self, path: &Path) -> FileError {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let json = Path::new(name.as_ref()).with_extension("json");
        let json = json.to_string_lossy();
        let what = self.what;
        let problem = match self.export {
            Export::Python(lines) => {
                let lines = lines
                    .replace("IN", &format!("{name:?}"))
                    .replace("OUT", &format!("{json:?}"))
                    .replace('\n', "; ");
                format!(
                    "is {what}, which is not read: write it as JSON with this Python, and give {json}: `{lines}`; \
                     calibrations"
                )
            }
            Export::Words(words) => {
                let words = words.replace("IN", &name).replace("OUT", &json);
                format!("is {what}, which is not read: {words}; calibrations")
            }
        };
        FileError::new(
            path,
            format!("{problem} are read in these formats: {FORMATS_READ}"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(bytes: &[u8], name: &str) -> String {
        let refused = text_of(bytes.to_vec(), Path::new(name)).unwrap_err();
        let refused = refused.to_string();
        assert!(refused.contains("opencv-json, qualisys"), "{refused}");
        for word in ["UTF-8", "encoding", "stream"] {
            assert!(!refused.contains(word), "{refused}");
        }
        refused
    }

    #[test]
    fn binary_files_are_named_by_their_content_with_a_way_to_text() {
        for (bytes, what, remedy) in [
            (
                &b"\x80\x04\x95\x7f\x02\0}"[..],
                "a Python pickle",
                "pickle.load(open(\"rig.cal\", \"rb\"))",
            ),
            (b"(dp0\nS'K'\n", "a Python pickle", "\"rig.json\""),
            (
                b"PK\x03\x04\x14\0mtx.npy\x80",
                "NumPy arrays",
                "numpy.load(\"rig.cal\"",
            ),
            (
                b"PK\x03\x04\x14\0xl/workbook.xml\x80",
                "an Excel workbook",
                "export the cameras",
            ),
            (
                b"PK\x03\x04\x14\0rig.toml\x80",
                "a ZIP archive",
                "unpack it",
            ),
            (b"\x93NUMPY\x01\0v\0", "a NumPy array", "numpy.load"),
            (
                b"MATLAB 5.0 MAT-file\0\x01",
                "a MATLAB file",
                "jsonencode(load('rig.cal'))",
            ),
            (b"\x89HDF\r\n\x1a\n\0", "an HDF5 file", "export the cameras"),
            (b"\x1f\x8b\x08\0", "a gzip archive", "unpack it"),
            (b"\0\0\0\x20ftypisom", "a video", "holds the cameras"),
            (
                b"\x01\0NP\xff\xfe\x80#~",
                "binary",
                "export the cameras as text from the program",
            ),
        ] {
            let refused = refused(bytes, "rig/rig.cal");
            let expected = format!("rig/rig.cal: is {what}");
            let is_named = refused.starts_with(&expected) || refused.contains(what);
            assert!(is_named && refused.contains(remedy), "{refused}");
        }
    }

    #[test]
    fn other_text_encodings_are_accepted() {
        let path = Path::new("a.xml");
        let text = "<name>Süd</name>\n";
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        assert_eq!(text_of(latin, path).as_deref(), Ok(text));
        assert_eq!(text_of(text.into(), path).as_deref(), Ok(text));
        let units: Vec<u16> = text.encode_utf16().collect();
        let little = [0xff, 0xfe]
            .into_iter()
            .chain(units.iter().flat_map(|it| it.to_le_bytes()));
        assert_eq!(text_of(little.collect(), path).as_deref(), Ok(text));
        let big = [0xfe, 0xff]
            .into_iter()
            .chain(units.iter().flat_map(|it| it.to_be_bytes()));
        assert_eq!(text_of(big.collect(), path).as_deref(), Ok(text));
    }
}
