//! Finds a network's files in a downloaded archive: `.tgz` of npm, `.whl` of pip, or the files themselves.

use std::fs::File;
use std::io::{self, ErrorKind, Read as _, Seek as _};
use std::path::Path;

use flate2::read::{DeflateDecoder, GzDecoder};

/// Largest file that is read from an archive, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Most unpacked bytes of a `.tgz` that are searched.
const MAX_UNPACKED_BYTES: u64 = 4 << 30;
/// Most files of an archive that are searched.
const MAX_ENTRIES: usize = 100_000;

const GZIP: &[u8] = &[0x1f, 0x8b];
const ZIP: &[u8] = b"PK\x03\x04";
/// Start of an entry in the list at the end of a zip archive.
const ZIP_ENTRY: &[u8] = b"PK\x01\x02";
/// Start of the last record, which says where that list is.
const ZIP_END: &[u8] = b"PK\x05\x06";
/// Position of the number of entries in the last record.
const ZIP_END_ENTRIES: usize = 10;
/// Position of the list's position in the last record.
const ZIP_END_LIST: usize = 16;

/// The files called `names`, in any folder of the archive at `path`.
///
/// A `path` that is no archive is the file itself. Of several files it is one, and the others are next to it.
///
/// # Errors
/// When one cannot be read, is damaged, or exceeds 1 GiB. [`ErrorKind::NotFound`] with a message if the archive lacks
/// one.
pub(crate) fn read_files(path: &Path, names: &[&str]) -> io::Result<Vec<Vec<u8>>> {
    if !path.metadata()?.is_file() {
        let problem = "found something other than a file";
        return Err(io::Error::new(ErrorKind::InvalidData, problem));
    }
    let mut file = File::open(path)?;
    let mut head = Vec::new();
    (&mut file).take(4).read_to_end(&mut head)?;
    file.rewind()?;
    let found = if head.starts_with(GZIP) {
        in_tar(file, names)?
    } else if head.starts_with(ZIP) {
        let bytes = bounded(file)?;
        let files = names.iter().map(|name| in_zip(&bytes, name));
        files.collect::<io::Result<_>>()?
    } else if let [_] = names {
        vec![Some(bounded(file)?)]
    } else {
        return next_to(path, names);
    };
    let files = found.into_iter().zip(names).map(|(file, name)| {
        file.ok_or_else(|| {
            let problem = format!("found an archive without {name}");
            io::Error::new(ErrorKind::NotFound, problem)
        })
    });
    files.collect()
}

/// The files called `names` in the folder of `path`.
fn next_to(path: &Path, names: &[&str]) -> io::Result<Vec<Vec<u8>>> {
    let files = names.iter().map(|name| {
        let file = File::open(path.with_file_name(name)).map_err(|error| {
            let problem = format!("opening {name} in the same folder: {error}");
            io::Error::new(error.kind(), problem)
        })?;
        bounded(file)
    });
    files.collect()
}

/// The first file of each name.
fn in_tar(file: File, names: &[&str]) -> io::Result<Vec<Option<Vec<u8>>>> {
    let mut found = vec![None; names.len()];
    let mut archive = tar::Archive::new(GzDecoder::new(file).take(MAX_UNPACKED_BYTES));
    for entry in archive.entries()?.take(MAX_ENTRIES) {
        let entry = entry?;
        if !entry.header().entry_type().is_file() {
            continue;
        }
        let path = entry.path()?.into_owned();
        let is_named = |name: &&str| path.file_name().is_some_and(|it| it == *name);
        let Some(index) = names.iter().position(is_named) else {
            continue;
        };
        if found[index].is_none() {
            found[index] = Some(bounded(entry)?);
        }
        if found.iter().all(Option::is_some) {
            break;
        }
    }
    Ok(found)
}

/// The file called `name` in the wheel `bytes`. Its checksum is not compared: the caller compares a fingerprint.
fn in_zip(bytes: &[u8], name: &str) -> io::Result<Option<Vec<u8>>> {
    let damaged = || io::Error::new(ErrorKind::InvalidData, "found a damaged zip archive");
    let number = |at: usize| -> io::Result<usize> {
        let part = at.checked_add(4).and_then(|end| bytes.get(at..end));
        let part = part
            .and_then(|part| part.try_into().ok())
            .ok_or_else(damaged)?;
        Ok(u32::from_le_bytes(part) as usize)
    };
    let short = |at: usize| number(at).map(|it| it & 0xffff);
    let part = |start: usize, len: usize| {
        let end = start.checked_add(len);
        end.and_then(|end| bytes.get(start..end))
            .ok_or_else(damaged)
    };
    let last = bytes.windows(4).rposition(|it| it == ZIP_END);
    let last = last.ok_or_else(damaged)?;
    let mut entry = number(last + ZIP_END_LIST)?;
    for _ in 0..short(last + ZIP_END_ENTRIES)? {
        if part(entry, 4)? != ZIP_ENTRY {
            return Err(damaged());
        }
        let length = short(entry + 28)?;
        let path = part(entry + 46, length)?;
        if path.rsplit(|&byte| byte == b'/').next() == Some(name.as_bytes()) {
            let local = number(entry + 42)?;
            let start = local + 30 + short(local + 26)? + short(local + 28)?;
            let packed = part(start, number(entry + 20)?)?;
            return match short(entry + 10)? {
                0 => bounded(packed).map(Some),
                8 => bounded(DeflateDecoder::new(packed)).map(Some),
                other => {
                    let problem =
                        format!("found {name} in the zip compression {other}, expected 0 or 8");
                    Err(io::Error::new(ErrorKind::InvalidData, problem))
                }
            };
        }
        entry += 46 + length + short(entry + 30)? + short(entry + 32)?;
    }
    Ok(None)
}

fn bounded(from: impl io::Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let problem = format!("found more than {MAX_FILE_BYTES} bytes");
        return Err(io::Error::new(ErrorKind::InvalidData, problem));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use flate2::Compression;
    use flate2::write::{DeflateEncoder, GzEncoder};

    use super::*;

    fn tgz(path: &Path, files: &[(&str, &[u8])]) {
        let encoder = GzEncoder::new(File::create(path).unwrap(), Compression::fast());
        let mut archive = tar::Builder::new(encoder);
        for (name, bytes) in files {
            let mut header = tar::Header::new_gnu();
            header.set_size(bytes.len() as u64);
            archive.append_data(&mut header, name, *bytes).unwrap();
        }
        archive.into_inner().unwrap().finish().unwrap();
    }

    /// Writes a zip archive. Every second file is compressed.
    fn wheel(path: &Path, files: &[(&str, &[u8])]) {
        let (mut out, mut list) = (Vec::new(), Vec::new());
        for (i, (name, bytes)) in files.iter().enumerate() {
            let mut packed = bytes.to_vec();
            if i % 2 == 1 {
                let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
                encoder.write_all(bytes).unwrap();
                packed = encoder.finish().unwrap();
            }
            let method = 8 * (i as u16 % 2);
            let sizes = [packed.len() as u32, bytes.len() as u32].map(u32::to_le_bytes);
            let length = (name.len() as u16).to_le_bytes();
            // Version, flags, method, time and checksum, of which only the method is read.
            let head = [
                &[0; 4],
                &method.to_le_bytes()[..],
                &[0; 8],
                &sizes.concat(),
                &length,
            ];
            let head = head.concat();
            let local = (out.len() as u32).to_le_bytes();
            out.extend([ZIP, &head, &[0; 2], name.as_bytes(), &packed].concat());
            let entry = [ZIP_ENTRY, &[0; 2], &head, &[0; 12], &local, name.as_bytes()];
            list.extend(entry.concat());
        }
        let n = (files.len() as u16).to_le_bytes();
        let sizes = [list.len() as u32, out.len() as u32].map(u32::to_le_bytes);
        let end = [ZIP_END, &[0; 4], &n, &n, &sizes.concat(), &[0; 2]];
        std::fs::write(path, [out, list, end.concat()].concat()).unwrap();
    }

    #[test]
    fn a_file_is_found_in_either_archive_and_by_itself() {
        let folder = tempfile::tempdir().unwrap();
        let files: [(&str, &[u8]); 3] = [
            ("package/other.tflite", b"other"),
            ("package/deep/net.tflite", b"weights"),
            ("package/last", b""),
        ];
        let paths = ["a.tgz", "a.whl", "renamed"].map(|name| folder.path().join(name));
        tgz(&paths[0], &files);
        wheel(&paths[1], &files);
        std::fs::write(&paths[2], b"weights").unwrap();
        for path in &paths {
            assert_eq!(read_files(path, &["net.tflite"]).unwrap(), [b"weights"]);
        }
        for path in &paths[..2] {
            let both = read_files(path, &["net.tflite", "other.tflite"]).unwrap();
            assert_eq!(both, [&b"weights"[..], b"other"]);
            let error = read_files(path, &["net.tflite", "absent.tflite"]).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NotFound);
            assert!(error.to_string().contains("absent.tflite"));
        }
    }

    #[test]
    fn a_damaged_archive_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for start in [GZIP, ZIP] {
            std::fs::write(&path, [start, &[7; 100]].concat()).unwrap();
            assert!(read_files(&path, &["net.tflite"]).is_err());
        }
        assert!(read_files(folder.path(), &["net.tflite"]).is_err());
    }

    #[test]
    fn several_files_without_an_archive_are_read_from_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["net.json", "net.bin"];
        let path = folder.path().join(names[0]);
        std::fs::write(&path, b"graph").unwrap();
        let error = read_files(&path, &names).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("opening net.bin in the same folder")
        );
        std::fs::write(folder.path().join(names[1]), b"weights").unwrap();
        let files = read_files(&path, &names).unwrap();
        assert_eq!(files, [&b"graph"[..], b"weights"]);
    }
}
