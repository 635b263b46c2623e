//! A small picture of a camera for display, if the venue allows pictures to leave the edge
//! ([`crate::venue::Security::pictures`]).
//!
//! Fusion computes nothing from it, and never decodes or records it, but passes it to viewers. The
//! checks protect a browser: number of bytes, a JPEG header, and the number of pixels in the
//! header.

use serde::{Deserialize, Serialize};

use crate::id::{CameraIndex, SessionId, ViewpointIndex};
use crate::tick::Tick;
use crate::wire::Message;

/// Most bytes of the picture.
pub const MAX_THUMBNAIL_BYTES: usize = 24 * 1024;
/// Most pixels of its width, and of its height.
pub const MAX_THUMBNAIL_PX: u16 = 320;
/// Largest rate of thumbnails per camera.
pub const THUMBNAILS_PER_S: u32 = 1;

/// Edge to fusion: the picture of one camera at a tick, reduced, without lens distortion.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Thumbnail {
    /// The session that the edge follows.
    pub session: SessionId,
    /// The tick of the picture.
    pub tick: Tick,
    /// The sender's viewpoint.
    pub viewpoint: ViewpointIndex,
    /// The camera.
    pub camera: CameraIndex,
    /// The picture as a JPEG file: the camera's whole undistorted image, reduced.
    pub jpeg: Vec<u8>,
}

const TOO_LONG: &str = "a thumbnail with too many bytes";
const NOT_JPEG: &str = "a thumbnail that is not a JPEG file";
const WRONG_SIZE: &str = "a thumbnail of an impossible size";

impl Message for Thumbnail {
    fn check(&self) -> Result<(), &'static str> {
        if self.jpeg.len() > MAX_THUMBNAIL_BYTES {
            return Err(TOO_LONG);
        }
        match jpeg_size_px(&self.jpeg) {
            None => Err(NOT_JPEG),
            Some(size_px)
                if size_px
                    .iter()
                    .all(|side| (1..=MAX_THUMBNAIL_PX).contains(side)) =>
            {
                Ok(())
            }
            Some(_) => Err(WRONG_SIZE),
        }
    }
}

/// Width and height of a JPEG file, from its frame header (ITU-T T.81, B.2.2). `None` if it is not
/// JPEG, or is neither baseline nor progressive. The rest of the file is not read.
fn jpeg_size_px(file: &[u8]) -> Option<[u16; 2]> {
    /// Start of image.
    const BEGIN: [u8; 2] = [0xff, 0xd8];
    let mut rest = file.strip_prefix(&BEGIN)?;
    // Each segment has at least two bytes of length, so the loop ends with the file.
    loop {
        let [0xff, marker, high, low, body @ ..] = rest else {
            return None;
        };
        let length = usize::from(u16::from_be_bytes([*high, *low])).checked_sub(2)?;
        match marker {
            // Frames of sequential and progressive Huffman coding, as browsers support.
            0xc0..=0xc2 => {
                let [_precision, h0, h1, w0, w1, ..] = body.get(..length)? else {
                    return None;
                };
                return Some([
                    u16::from_be_bytes([*w0, *w1]),
                    u16::from_be_bytes([*h0, *h1]),
                ]);
            }
            // Tables, application data and comments may precede the frame.
            0xc4 | 0xdb | 0xdd | 0xe0..=0xef | 0xfe => rest = body.get(length..)?,
            _ => return None,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::wire::{WireError, decode, encode};

    /// The header of a baseline JPEG file of this size, without picture data.
    pub(crate) fn jpeg(width: u16, height: u16) -> Vec<u8> {
        let mut file = vec![0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc0, 0, 11, 8];
        file.extend(height.to_be_bytes());
        file.extend(width.to_be_bytes());
        file.extend([1, 1, 0x11, 0, 0xff, 0xd9]);
        file
    }

    fn thumbnail(jpeg: Vec<u8>) -> Thumbnail {
        Thumbnail {
            session: SessionId(9),
            tick: Tick(-4),
            viewpoint: ViewpointIndex(1),
            camera: CameraIndex(3),
            jpeg,
        }
    }

    fn refused(jpeg: Vec<u8>) -> &'static str {
        match decode::<Thumbnail>(&encode(&thumbnail(jpeg))) {
            Err(WireError::Invalid(why)) => why,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_thumbnail_is_read_back() {
        for size in [(1, 1), (320, 180), (240, 320)] {
            let message = thumbnail(jpeg(size.0, size.1));
            assert_eq!(decode(&encode(&message)), Ok(message));
        }
    }

    #[test]
    fn invalid_and_oversized_jpeg_files_are_refused() {
        assert_eq!(refused(Vec::new()), NOT_JPEG);
        assert_eq!(refused(b"\x89PNG\r\n\x1a\n".to_vec()), NOT_JPEG);
        assert_eq!(refused(b"<svg onload=alert(1)>".to_vec()), NOT_JPEG);
        for size in [(321, 180), (65_535, 65_535), (320, 0), (0, 180)] {
            assert_eq!(refused(jpeg(size.0, size.1)), WRONG_SIZE, "{size:?}");
        }
        let mut long = jpeg(320, 180);
        long.resize(MAX_THUMBNAIL_BYTES + 1, 0);
        assert_eq!(refused(long), TOO_LONG);
    }

    #[test]
    fn a_file_with_invalid_segments_is_refused() {
        let whole = jpeg(320, 180);
        for end in 0..whole.len() - 8 {
            assert_eq!(refused(whole[..end].to_vec()), NOT_JPEG, "{end}");
        }
        // A segment shorter than its own length field, one longer than the file, and an end before
        // the frame.
        for segment in [
            [0xff, 0xe0, 0, 1],
            [0xff, 0xe0, 0xff, 0xff],
            [0xff, 0xd9, 0, 4],
        ] {
            let file = [&[0xff, 0xd8], segment.as_slice(), &whole[2..]].concat();
            assert_eq!(refused(file), NOT_JPEG, "{segment:x?}");
        }
    }
}
