//! The names of bones.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use crate::motion::bvh::Bvh;

/// The bones of the body's joints; pairs are left, right.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NamedBones {
    /// The bone that carries both hips and the trunk.
    pub(super) pelvis: usize,
    /// The bone after the pelvis on the path to the neck.
    pub(super) first_spine: usize,
    pub(super) neck: usize,
    pub(super) head: Option<usize>,
    pub(super) eye: Option<[usize; 2]>,
    pub(super) collar: Option<[usize; 2]>,
    pub(super) shoulder: [usize; 2],
    pub(super) elbow: [usize; 2],
    pub(super) wrist: [usize; 2],
    /// The roots of the fingers, without the thumb.
    pub(super) knuckles: [Vec<usize>; 2],
    pub(super) hip: [usize; 2],
    pub(super) knee: [usize; 2],
    pub(super) ankle: [usize; 2],
    pub(super) toe: Option<[usize; 2]>,
}

/// The first match wins: with `LeftArm`, `LeftShoulder` is the collar bone.
const SHOULDER: &[&str] = &["arm", "upperarm", "uparm", "shldr", "shoulder"];
const COLLAR: &[&str] = &["collar", "clavicle", "scapula", "shoulder"];
const ELBOW: &[&str] = &["elbow", "forearm", "lowerarm", "lowarm"];
const WRIST: &[&str] = &["wrist", "hand"];
const HIP: &[&str] = &["upleg", "thigh", "upperleg", "hip"];
const KNEE: &[&str] = &["knee", "shin", "calf", "lowerleg", "lowleg", "leg"];
const ANKLE: &[&str] = &["ankle", "foot"];
const TOE: &[&str] = &["toebase", "toe", "toes", "ball"];
const NECK: &[&str] = &["neck", "necktwist01", "neck1", "neck01", "lowerneck"];
const HEAD: &[&str] = &["head"];
const EYE: &[&str] = &["eye"];

impl NamedBones {
    pub(super) fn find(bvh: &Bvh, path: &Path) -> Result<Self, FileError> {
        let index = BoneIndex::new(bvh);
        let mut missing = Vec::new();
        let mut need = |what: &'static str, found: Option<[usize; 2]>| {
            found.unwrap_or_else(|| {
                missing.push(what);
                [0, 0]
            })
        };
        let shoulder = need("shoulders", index.pair(SHOULDER));
        let elbow = need("elbows", index.pair(ELBOW));
        let wrist = need("wrists", index.pair(WRIST));
        let hip = need("hips", index.pair(HIP));
        let knee = need("knees", index.pair(KNEE));
        let ankle = need("ankles", index.pair(ANKLE));
        let neck = need("neck", index.middle(NECK).map(|neck| [neck, neck]))[0];
        if !missing.is_empty() {
            let found: Vec<&str> = bvh.bones.iter().map(|bone| bone.name.as_str()).collect();
            return Err(FileError::new(
                path,
                format!(
                    "found no bones for {}, expected names as `left_hip`, `LeftUpLeg` or `lThigh`; the bones are {}",
                    missing.join(", "),
                    shortened(&found.join(", "))
                ),
            ));
        }
        check_chains(
            bvh,
            path,
            &[
                [hip, knee],
                [knee, ankle],
                [shoulder, elbow],
                [elbow, wrist],
            ],
        )?;
        let (pelvis, first_spine) = trunk(bvh, hip, neck).ok_or_else(|| {
            FileError::new(
                path,
                "found a neck that is not above the hips in the tree of bones, expected one pelvis that carries both",
            )
        })?;
        Ok(Self {
            pelvis,
            first_spine,
            neck,
            head: index.middle(HEAD).filter(|&head| is_under(bvh, head, neck)),
            eye: index.pair(EYE),
            collar: index
                .pair(COLLAR)
                .filter(|collar| hang(bvh, shoulder, *collar) && *collar != shoulder),
            shoulder,
            elbow,
            wrist,
            knuckles: [knuckles(bvh, wrist[0]), knuckles(bvh, wrist[1])],
            hip,
            knee,
            ankle,
            toe: index
                .pair(TOE)
                .filter(|toe| (0..2).all(|side| bvh.bones[toe[side]].parent == Some(ankle[side]))),
        })
    }
}

/// Bones by plain name: lower case, letters and digits only, without a vendor's prefix.
struct BoneIndex(BTreeMap<String, usize>);

impl BoneIndex {
    fn new(bvh: &Bvh) -> Self {
        let mut index = BTreeMap::new();
        for (i, bone) in bvh.bones.iter().enumerate() {
            index.entry(plain(&bone.name)).or_insert(i);
        }
        Self(index)
    }

    fn middle(&self, parts: &[&str]) -> Option<usize> {
        parts.iter().find_map(|part| self.0.get(*part).copied())
    }

    /// Left and right of the first part that has both.
    fn pair(&self, parts: &[&str]) -> Option<[usize; 2]> {
        parts.iter().find_map(|part| {
            let left = self.side(part, "left", "l")?;
            let right = self.side(part, "right", "r")?;
            Some([left, right])
        })
    }

    fn side(&self, part: &str, long: &str, short: &str) -> Option<usize> {
        [
            format!("{long}{part}"),
            format!("{short}{part}"),
            format!("{part}{long}"),
            format!("{part}{short}"),
        ]
        .iter()
        .find_map(|name| self.0.get(name).copied())
    }
}

fn plain(name: &str) -> String {
    let name = name.rsplit(':').next().unwrap_or(name);
    let name = name.strip_prefix("CC_Base_").unwrap_or(name);
    name.chars()
        .filter(char::is_ascii_alphanumeric)
        .map(|c| c.to_ascii_lowercase())
        .collect()
}

/// A list of names, shortened for an error message.
fn shortened(names: &str) -> String {
    const LONGEST: usize = 400;
    match names.char_indices().nth(LONGEST) {
        None => names.to_owned(),
        Some((end, _)) => format!("{} ...", &names[..end]),
    }
}

fn knuckles(bvh: &Bvh, wrist: usize) -> Vec<usize> {
    let children = bvh.bones.iter().enumerate();
    children
        .filter(|(_, bone)| bone.parent == Some(wrist) && !plain(&bone.name).contains("thumb"))
        .map(|(i, _)| i)
        .collect()
}

/// Whether `bone` is `above` or one of its descendants.
fn is_under(bvh: &Bvh, bone: usize, above: usize) -> bool {
    ancestors(bvh, bone).any(|i| i == above)
}

/// Whether each of `bones` descends from its counterpart in `above`.
fn hang(bvh: &Bvh, bones: [usize; 2], above: [usize; 2]) -> bool {
    bones
        .into_iter()
        .zip(above)
        .all(|(bone, above)| is_under(bvh, bone, above))
}

/// The bone itself, its parent, and so on to the root.
fn ancestors(bvh: &Bvh, bone: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(bone), |&i| bvh.bones[i].parent)
}

fn check_chains(bvh: &Bvh, path: &Path, chains: &[[[usize; 2]; 2]]) -> Result<(), FileError> {
    for [above, below] in chains {
        for side in 0..2 {
            let (above, below) = (above[side], below[side]);
            if above == below || !is_under(bvh, below, above) {
                let (above, below) = (&bvh.bones[above].name, &bvh.bones[below].name);
                let problem =
                    format!("found `{below}` outside the chain of `{above}`, expected it below");
                return Err(FileError::new(path, problem));
            }
        }
    }
    Ok(())
}

/// The lowest common ancestor of hips and neck, and the next bone towards the neck.
fn trunk(bvh: &Bvh, hip: [usize; 2], neck: usize) -> Option<(usize, usize)> {
    let mut next = neck;
    for bone in ancestors(bvh, neck).skip(1) {
        if is_under(bvh, hip[0], bone) && is_under(bvh, hip[1], bone) {
            let apart = !hip.contains(&bone);
            return apart.then_some((bone, next));
        }
        next = bone;
    }
    None
}
