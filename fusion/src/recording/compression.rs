//! Decompression of the chunks of other tools' MCAP files: `lz4` and `zstd`, without C.

use std::io::{self, Cursor, Read};

use lz4_flex::frame::FrameDecoder as Lz4CompressedFrame;
use mcap::sans_io::decompressor::{DecompressResult, Decompressor};
use mcap::{McapError, McapResult};
use ruzstd::decoding::{FrameDecoder, StreamingDecoder};

/// Compression of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CompressionFormat {
    /// LZ4's frames.
    Lz4,
    /// Zstandard.
    Zstd,
}

/// Decompresses whole chunks, one after the other.
pub(super) struct Decompression {
    format: CompressionFormat,
    /// Largest window of a frame, bytes: its memory cost.
    most_window_bytes: u64,
    /// The current chunk.
    frame: Option<CompressedFrame>,
}

/// A frame of a chunk, and the bytes after it.
enum CompressedFrame {
    Lz4(Box<Lz4CompressedFrame<Packed>>),
    Zstd(Box<StreamingDecoder<Packed, FrameDecoder>>),
}

type Packed = Cursor<Vec<u8>>;

impl Decompression {
    /// For chunks of `format`; zstd frames with a larger window are refused.
    pub(super) fn new(format: CompressionFormat, most_window_bytes: u64) -> Self {
        Self {
            format,
            most_window_bytes,
            frame: None,
        }
    }

    fn open(&self, packed: Packed) -> McapResult<CompressedFrame> {
        match self.format {
            CompressionFormat::Lz4 => Ok(CompressedFrame::Lz4(Box::new(Lz4CompressedFrame::new(
                packed,
            )))),
            CompressionFormat::Zstd => {
                StreamingDecoder::new_with_max_window_size(packed, self.most_window_bytes)
                    .map(|frame| CompressedFrame::Zstd(Box::new(frame)))
                    .map_err(|problem| McapError::DecompressionError(problem.to_string()))
            }
        }
    }
}

impl Decompressor for Decompression {
    fn next_read_size(&self) -> usize {
        // A whole chunk: neither decoder continues after the end of its input.
        if self.frame.is_some() { 0 } else { usize::MAX }
    }

    fn decompress(&mut self, src: &[u8], dst: &mut [u8]) -> McapResult<DecompressResult> {
        let (mut frame, consumed) = match self.frame.take() {
            Some(frame) => (frame, 0),
            None => (self.open(Cursor::new(src.to_vec()))?, src.len()),
        };
        let mut wrote = frame.read(dst)?;
        // A new decoder for every frame: each begins with empty buffers.
        while wrote == 0 && frame.is_followed() {
            frame = self.open(frame.into_packed())?;
            wrote = frame.read(dst)?;
        }
        self.frame = Some(frame);
        Ok(DecompressResult { consumed, wrote })
    }

    fn reset(&mut self) -> McapResult<()> {
        self.frame = None;
        Ok(())
    }

    fn name(&self) -> &'static str {
        match self.format {
            CompressionFormat::Lz4 => "lz4",
            CompressionFormat::Zstd => "zstd",
        }
    }
}

impl CompressedFrame {
    fn is_followed(&self) -> bool {
        let packed = match self {
            Self::Lz4(frame) => frame.get_ref(),
            Self::Zstd(frame) => frame.get_ref(),
        };
        packed.position() < packed.get_ref().len() as u64
    }

    fn into_packed(self) -> Packed {
        match self {
            Self::Lz4(frame) => frame.into_inner(),
            Self::Zstd(frame) => frame.into_inner(),
        }
    }
}

impl Read for CompressedFrame {
    fn read(&mut self, unpacked: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Lz4(frame) => frame.read(unpacked),
            Self::Zstd(frame) => frame.read(unpacked),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::chunk_tests::pack;
    use super::*;

    /// The output, in pieces of `piece` bytes; `None` if it is refused.
    fn unpack(
        format: CompressionFormat,
        packed: &[u8],
        most: usize,
        piece: usize,
    ) -> Option<Vec<u8>> {
        let mut decompression = Decompression::new(format, 1 << 20);
        let (mut src, mut unpacked) = (packed, Vec::new());
        while unpacked.len() < most {
            let mut room = vec![0; piece];
            let got = decompression.decompress(src, &mut room).ok()?;
            if got.consumed == 0 && got.wrote == 0 {
                return None;
            }
            src = &src[got.consumed..];
            unpacked.extend(&room[..got.wrote]);
        }
        Some(unpacked)
    }

    const FORMATS: [CompressionFormat; 2] = [CompressionFormat::Lz4, CompressionFormat::Zstd];

    /// A text written by liblz4 1.9, hexadecimal.
    const BY_LIBLZ4: &str = "04224d186840ec00000000000000754c000000f10e7469636b20303a2074686520706572736f6e2077616c6b73206f6e \
        2e201d001f311d00091f341d00091f391d00092f31361e00092f32351e00091f333c000a1f3478000050206f6e2e2000 \
        000000";
    /// The same written by libzstd 1.5, with its checksum.
    const BY_LIBZSTD: &str = "28b52ffd24ecf5010084027469636b20303a2074686520706572736f6e2077616c6b73206f6e2e203134393136323533 \
        3634390800a0c680c141198c070601c30023806fe0524e833ef8a3";

    #[test]
    fn output_of_the_reference_libraries_is_read() {
        let sentences = (0..8).map(|i| format!("tick {}: the person walks on. ", i * i));
        let text = sentences.collect::<Vec<_>>().concat();
        for (format, hex) in [
            (CompressionFormat::Lz4, BY_LIBLZ4),
            (CompressionFormat::Zstd, BY_LIBZSTD),
        ] {
            let digits: Vec<char> = hex.chars().filter(char::is_ascii_hexdigit).collect();
            let bytes = digits
                .chunks(2)
                .map(|pair| u8::from_str_radix(&String::from_iter(pair), 16).unwrap());
            let packed: Vec<u8> = bytes.collect();
            let unpacked = unpack(format, &packed, text.len(), 50).unwrap();
            assert_eq!(String::from_utf8(unpacked).unwrap(), text);
        }
    }

    proptest! {
        #[test]
        fn decompression_works_in_pieces_of_any_size(
            text in prop::collection::vec(0u8..4, 1..2000), piece in 1usize..600,
        ) {
            for format in FORMATS {
                let packed = pack(format, &text);
                let unpacked = unpack(format, &packed, text.len(), piece);
                prop_assert_eq!(unpacked.as_ref(), Some(&text));
                let twice = [&packed[..], &packed[..]].concat();
                let both = text.repeat(2);
                prop_assert_eq!(unpack(format, &twice, both.len(), piece), Some(both));
            }
        }

        #[test]
        fn no_bytes_panic_a_decoder(
            text in prop::collection::vec(0u8..4, 1..300),
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            rest in any::<Vec<u8>>(),
        ) {
            for format in FORMATS {
                let mut packed = [pack(format, &text), rest.clone()].concat();
                for (at, byte) in &changes {
                    let at = at.index(packed.len());
                    packed[at] = *byte;
                }
                drop(unpack(format, &packed, 100_000, 64));
                drop(unpack(format, &rest, 100_000, 64));
            }
        }
    }

    #[test]
    fn a_frame_with_too_large_a_window_is_refused() {
        // Magic, descriptor without a size, window of 2^(10 + 31) bytes, then an empty last block.
        let frame = [0x28, 0xb5, 0x2f, 0xfd, 0x00, 0xf8, 0x01, 0x00, 0x00];
        assert_eq!(unpack(CompressionFormat::Zstd, &frame, 1, 1), None);
        let mut decompression = Decompression::new(CompressionFormat::Zstd, 1 << 20);
        let refused = decompression.decompress(&frame, &mut [0; 4]).unwrap_err();
        assert!(refused.to_string().contains("indow"), "{refused}");
    }
}
