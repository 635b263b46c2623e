//! Shape and clothes of one person, drawn from a seed.

use farfield_fusion::body::skeleton::Side;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Reflectance of a surface: linear red, green, blue, each from 0 to 1.
pub type Color = [f32; 3];

/// Hair style.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hair {
    /// None.
    Bald,
    /// A cap.
    Short,
    /// A cap, and hair down to the neck.
    Long,
    /// A cap and a tail.
    Tail,
}

/// Pattern of the shirt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShirtPattern {
    /// Nothing.
    Plain,
    /// Rings around the body.
    Hoops,
    /// Stripes from the shoulders down.
    Stripes,
    /// The left half in the second colour.
    Halves,
    /// Coloured sleeves.
    Sleeves,
    /// A band across the chest.
    Band,
}

/// Shape and clothes of one person.
#[derive(Debug, Clone, PartialEq)]
pub struct Build {
    /// Body height, metres.
    pub stature_m: f64,
    /// Thickness of limbs and trunk relative to the mean of adults.
    pub girth: f64,
    /// Breadth of the chest relative to the mean.
    pub chest: f64,
    /// Breadth of the hips relative to the mean.
    pub hips: f64,
    /// Hair style.
    pub hair: Hair,
    /// Skin.
    pub skin_color: Color,
    /// Hair.
    pub hair_color: Color,
    /// Shirt, its main and its second colour.
    pub shirt_colors: [Color; 2],
    /// Pattern of the shirt.
    pub pattern: ShirtPattern,
    /// Number on the back and, smaller, the chest.
    pub number: Option<u8>,
    /// Trousers.
    pub trousers_color: Color,
    /// Socks.
    pub socks_color: Color,
    /// Shoes.
    pub shoes_color: Color,
    /// Height of the shirt's hem above the hip centres, statures.
    pub belt: f64,
    /// End of the sleeves: 0 at the shoulder, 1 at the elbow, 2 at the wrist.
    pub sleeves: f64,
    /// End of the trousers: 0 at the hip, 1 at the knee, 2 at the ankle.
    pub trousers: f64,
    /// End of the socks, on the scale of [`Self::trousers`].
    pub socks: f64,
    /// Strength of creases in the clothes, 0 to 1.
    pub creases: f32,
    /// Seed of small details.
    pub seed: u64,
}

const SKIN: [[u8; 3]; 7] = [
    [250, 218, 190],
    [241, 194, 157],
    [228, 178, 138],
    [204, 145, 98],
    [168, 108, 68],
    [124, 76, 46],
    [84, 52, 36],
];

const HAIR: [[u8; 3]; 8] = [
    [18, 16, 15],
    [40, 28, 22],
    [66, 44, 30],
    [96, 66, 42],
    [150, 112, 66],
    [205, 172, 112],
    [128, 58, 30],
    [150, 148, 146],
];

impl Build {
    /// A build of the given stature; everything else is drawn from `seed`.
    pub fn from_seed(stature_m: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0062_7569_6c64);
        let slender = rng.random_range(0.0..1.0);
        let tone = rng.random_range(0..SKIN.len() - 1);
        let share = rng.random_range(0.0..1.0);
        let skin =
            std::array::from_fn(|c| mix(srgb(SKIN[tone])[c], srgb(SKIN[tone + 1])[c], share));
        let shirt = cloth(&mut rng);
        Self {
            stature_m,
            girth: rng.random_range(0.88..1.16),
            chest: 1.04 - 0.12 * slender + rng.random_range(-0.03..0.03),
            hips: 0.96 + 0.12 * slender + rng.random_range(-0.03..0.03),
            hair: match rng.random_range(0..100) {
                0..8 => Hair::Bald,
                8..60 => Hair::Short,
                60..80 => Hair::Tail,
                _ => Hair::Long,
            },
            skin_color: skin,
            hair_color: srgb(HAIR[rng.random_range(0..HAIR.len())]),
            shirt_colors: [shirt, cloth(&mut rng)],
            pattern: match rng.random_range(0..100) {
                0..45 => ShirtPattern::Plain,
                45..57 => ShirtPattern::Hoops,
                57..70 => ShirtPattern::Stripes,
                70..78 => ShirtPattern::Halves,
                78..90 => ShirtPattern::Sleeves,
                _ => ShirtPattern::Band,
            },
            number: rng.random_bool(0.55).then(|| rng.random_range(1..100)),
            trousers_color: if rng.random_bool(0.15) {
                shirt
            } else {
                cloth(&mut rng)
            },
            socks_color: cloth(&mut rng),
            shoes_color: cloth(&mut rng),
            sleeves: if rng.random_bool(0.55) {
                rng.random_range(0.35..0.95)
            } else if rng.random_bool(0.25) {
                0.05
            } else {
                rng.random_range(1.6..1.97)
            },
            trousers: if rng.random_bool(0.5) {
                rng.random_range(0.5..1.05)
            } else {
                rng.random_range(1.7..1.97)
            },
            socks: if rng.random_bool(0.4) {
                rng.random_range(1.1..1.3)
            } else {
                rng.random_range(1.8..1.97)
            },
            belt: rng.random_range(-0.03..0.05),
            creases: rng.random_range(0.2..1.0),
            seed,
        }
    }

    /// Gives the person the shirt, trousers and socks of `kit`, as for members of a team.
    #[must_use]
    pub fn in_kit_of(mut self, kit: &Self) -> Self {
        self.shirt_colors = kit.shirt_colors;
        self.pattern = kit.pattern;
        self.trousers_color = kit.trousers_color;
        self.socks_color = kit.socks_color;
        self
    }

    /// The sign of `side` in body axes that point left.
    pub(super) fn sign(side: Side) -> f64 {
        -side.mirror()
    }
}

/// The colour of a cloth: a third are greys, the others have any hue.
fn cloth(rng: &mut ChaCha8Rng) -> Color {
    let value: f32 = rng.random_range(0.05..0.95);
    if rng.random_bool(0.35) {
        let tint: f32 = rng.random_range(-0.04..0.04);
        return linear([value + tint, value, value - tint]);
    }
    let saturation: f32 = rng.random_range(0.3..1.0);
    let hue: f32 = rng.random_range(0.0..6.0);
    let value = 0.15 + 0.85 * value;
    linear(std::array::from_fn(|c| {
        let k = (hue + [5.0, 3.0, 1.0][c]).rem_euclid(6.0);
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    }))
}

fn srgb(bytes: [u8; 3]) -> Color {
    linear(bytes.map(|b| f32::from(b) / 255.0))
}

/// Converts display colours to reflectances.
fn linear(encoded: Color) -> Color {
    encoded.map(|v| v.clamp(0.0, 1.0).powf(2.2))
}

fn mix(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}
