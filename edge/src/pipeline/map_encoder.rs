//! What turns a crop's maps into bytes: the project's codec, unless a study has put another in its place.

use farfield_proto::patch::{CompressionLevel, EncodedMaps, Encoder, FLOOR, Maps};

/// Another codec in the place of the project's, for studies: what it makes of the maps is then sent
/// exactly.
#[cfg(feature = "study")]
pub trait StandIn: Send {
    /// Turns `maps`, of which nothing was left out yet, into what its decoder would give.
    fn recode(&mut self, maps: &mut Maps);
}

/// The codec of an edge, and how closely it keeps maps.
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

    /// How closely the next maps are kept.
    pub(super) fn set_level(&mut self, level: CompressionLevel) {
        self.level = level;
    }

    /// Lets `stand_in` do the codec's work from now on, whatever the level.
    #[cfg(feature = "study")]
    pub(super) fn set_stand_in(&mut self, stand_in: Box<dyn StandIn>) {
        self.stand_in = Some(stand_in);
    }

    /// Cells below this are not sent: whoever paints maps may leave them 0.
    pub(super) fn floor(&self) -> u8 {
        #[cfg(feature = "study")]
        if self.stand_in.is_some() {
            return 0;
        }
        FLOOR
    }

    /// The bytes of `maps`, which a stand-in changes into what it would give back.
    pub(super) fn encode(&mut self, maps: &mut Maps) -> EncodedMaps {
        #[cfg(feature = "study")]
        if let Some(stand_in) = &mut self.stand_in {
            stand_in.recode(maps);
            return self.encoder.encode_above(maps, 0);
        }
        self.encoder.encode(maps, self.level)
    }
}
