//! Encoding of a crop's maps: the project's codec, unless a study replaces it.

use farfield_proto::patch::{CompressionLevel, EncodedMaps, Encoder, FLOOR, Maps};

/// A replacement of the codec, for studies. Its result is then sent losslessly.
#[cfg(feature = "study")]
pub trait StandIn: Send {
    /// Replaces complete `maps` by the result of the other codec's decoder.
    fn recode(&mut self, maps: &mut Maps);
}

/// The codec of an edge, with its level.
pub(super) struct MapEncoder {
    encoder: Encoder,
    level: CompressionLevel,
    #[cfg(feature = "study")]
    stand_in: Option<Box<dyn StandIn>>,
}

impl MapEncoder {
    /// The project's codec at `level`.
    pub(super) fn new(level: CompressionLevel) -> Self {
        Self {
            encoder: Encoder::new(),
            level,
            #[cfg(feature = "study")]
            stand_in: None,
        }
    }

    /// Sets the level of the next maps.
    pub(super) fn set_level(&mut self, level: CompressionLevel) {
        self.level = level;
    }

    /// Replaces the codec by `stand_in` from now on, at every level.
    #[cfg(feature = "study")]
    pub(super) fn set_stand_in(&mut self, stand_in: Box<dyn StandIn>) {
        self.stand_in = Some(stand_in);
    }

    /// Cells below this value are not sent, so a painter can skip them.
    pub(super) fn floor(&self) -> u8 {
        #[cfg(feature = "study")]
        if self.stand_in.is_some() {
            return 0;
        }
        FLOOR
    }

    /// Encodes `maps`. A replacement changes them to its decoded result.
    pub(super) fn encode(&mut self, maps: &mut Maps) -> EncodedMaps {
        #[cfg(feature = "study")]
        if let Some(stand_in) = &mut self.stand_in {
            stand_in.recode(maps);
            return self.encoder.encode_above(maps, 0);
        }
        self.encoder.encode(maps, self.level)
    }
}
