//! `farfield networks check`, on people that the program renders: does the card say what its network
//! expects? Their keypoints are known, so a wrong normalisation, order of keypoints or offset of
//! cells shows.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use farfield_edge::crop::{CropGeometry, CropShape};
use farfield_edge::inference::{InputTensor, KeypointNetwork as _};
use farfield_edge::network::OnnxKeypointNetwork;
use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::boxes::{BoxShape, Boxes};
use farfield_proto::frames::Point;
use farfield_proto::id::CameraIndex;
use farfield_proto::model_card::{Channels, HeatmapCard, HeatmapTensors, Normalize};
use farfield_proto::order_statistics::upper_median;
use farfield_proto::venue::parameters::BoxParameters;
use farfield_score::points::LIMB_POINTS;
use farfield_sim::embedded;
use farfield_sim::render::{RenderSettings, Renderer};
use image::RgbImage;
use nalgebra::{Point3, Vector2};

use super::NETWORKS;
use crate::report_lines::ReportLines;

/// The scene with one person, every second camera of it, and the times of its pictures, seconds.
const SCENE: &str = "one";
const EVERY_CAMERA: usize = 2;
const TIMES_S: [f64; 6] = [0.5, 2.0, 3.5, 8.0, 9.5, 14.0];
/// Median distance from the truth above which a network sees nothing of a person, share of the
/// height. Trained networks reach 0.02.
const LOST: f64 = 0.1;
/// A map is another keypoint's if it is this many times nearer to that.
const NEARER: f64 = 2.0;
/// Share of the crops in which another normalisation must be better. Right ones are better in all,
/// others in about half.
const BETTER_SHARE: f64 = 0.85;
/// Error of the card's offset that is reported, cells: the measurement itself is good to 0.1.
const OFFSET_CELLS: f64 = 0.3;
/// Peaks below this height say nothing.
const LEAST_HEIGHT: f32 = 0.2;

/// A crop with the true places of [`LIMB_POINTS`], whose names are those of joints.
struct RenderedCrop {
    picture: RgbImage,
    limbs_px: [Vector2<f64>; LIMB_POINTS.len()],
    height_px: f64,
}

/// The highest place of a map.
#[derive(Clone, Copy)]
struct Peak {
    at_px: Vector2<f64>,
    height: f32,
}

/// How pixels become numbers.
struct InputForm {
    name: String,
    channels: Channels,
    normalize: Normalize,
}

/// Checks the card at `path` with rendered people, and adds what was found to `report`.
///
/// # Errors
/// The network cannot be loaded or run, or the scene cannot be rendered.
pub(super) fn check(
    path: &Path,
    card: &HeatmapCard,
    report: &mut ReportLines,
) -> anyhow::Result<()> {
    let names = card.output.keypoints.names();
    let map_of = |limb: &&str| names.iter().position(|name| name == limb);
    let maps: Option<Vec<usize>> = LIMB_POINTS.iter().map(map_of).collect();
    let Some(maps) = maps else {
        let text = "not compared with rendered people: it lacks some of the 12 keypoints of limbs";
        report.ok(NETWORKS, text);
        return Ok(());
    };
    let mut network = OnnxKeypointNetwork::load(path)?;
    let crops = rendered(card)?;
    let own = InputForm {
        name: "the card's".to_owned(),
        channels: card.input.channels,
        normalize: card.normalize.clone(),
    };
    let found = peaks(&mut network, &crops, &own, false)?;
    let distance = median(errors(&crops, &found, &maps));
    let order = wrong_order(&crops, &found, &maps);
    let better = match order {
        Some(_) => None,
        None => better_form(&mut network, &crops, &own, &found, &maps)?,
    };
    let heights = found
        .iter()
        .flat_map(|it| maps.iter().map(|&map| f64::from(it[map].height)));
    let text = format!(
        "{} rendered people: keypoints {:.1} % of their height from the truth, peaks {:.2} high (medians)",
        crops.len(),
        100.0 * distance,
        median(heights.collect())
    );
    if distance > LOST && better.is_none() && order.is_none() {
        let remedy =
            "compare `file`, `input` and `output` of the card with the network's own documentation";
        report.fail(NETWORKS, text, remedy);
        return Ok(());
    }
    report.ok(NETWORKS, text);
    if let Some(text) = better {
        report.warn(
            NETWORKS,
            text,
            "check `channels` and `normalize` of the card",
        );
        return Ok(());
    }
    if let Some(text) = order {
        report.fail(
            NETWORKS,
            text,
            "list `keypoints` in the order of the network's maps",
        );
        return Ok(());
    }
    let mirrored = peaks(&mut network, &crops, &own, true)?;
    if let Some(text) = wrong_offset(card, &found, &mirrored, &maps) {
        let remedy = match card.output.tensors {
            HeatmapTensors::Maps(_) => "correct `cell_to_input` of the card",
            HeatmapTensors::Simcc(_) => "correct `bins_per_pixel` of the card",
        };
        report.fail(NETWORKS, text, remedy);
    }
    Ok(())
}

/// Renders the people, as large in the crops as in the training of the network.
fn rendered(card: &HeatmapCard) -> anyhow::Result<Vec<RenderedCrop>> {
    let scene = Arc::new(embedded::scene(SCENE)?);
    let shape = BoxShape {
        margin: card.box_margin,
        reach_m: 0.0,
        parameters: BoxParameters::default(),
    };
    let mut crops = Vec::new();
    for camera in (0..scene.cameras().len()).step_by(EVERY_CAMERA) {
        let model = &scene.cameras()[camera];
        let renderer = Renderer::new(Arc::clone(&scene), camera, RenderSettings::default());
        let renderer = renderer.context("the scene lacks a camera")?;
        for time_s in TIMES_S {
            let person = scene
                .person_at(0, time_s)
                .context("the scene lacks its person")?;
            let joints_m = &person.joints_m;
            let index = CameraIndex(u16::try_from(camera)?);
            let found = Boxes::default().camera_box(index, model, (joints_m, joints_m), &shape);
            let region = found
                .context("the person is outside the picture")?
                .bounding_box;
            let crop = CropGeometry::new(&region, CropShape::of_card(card));
            let crop = crop.context("the person is too small")?;
            let place_px = |name: &str| {
                let at_m = person.joint_m(Joint::from_name(name)?);
                model
                    .project(Point::new(Point3::from(at_m)))
                    .map(|px| crop.input(px))
            };
            let limbs: Vec<Vector2<f64>> = LIMB_POINTS
                .iter()
                .filter_map(|name| place_px(name))
                .collect();
            let rows = |of: fn(f64, f64) -> f64| limbs.iter().map(|px| px.y).reduce(of);
            let height_px = rows(f64::max).unwrap_or(0.0) - rows(f64::min).unwrap_or(0.0);
            crops.push(RenderedCrop {
                picture: renderer
                    .render_crop(time_s, &crop)
                    .context("nothing was rendered")?,
                limbs_px: limbs
                    .try_into()
                    .ok()
                    .context("a joint is behind the camera")?,
                height_px,
            });
        }
    }
    Ok(crops)
}

/// The peaks of all maps by crop; `mirrored`: of the crops with left and right exchanged.
fn peaks(
    network: &mut OnnxKeypointNetwork,
    crops: &[RenderedCrop],
    form: &InputForm,
    mirrored: bool,
) -> anyhow::Result<Vec<Vec<Peak>>> {
    let mut found = Vec::with_capacity(crops.len());
    // One at a time: memory stays small with any network.
    for crop in crops {
        let maps = network.infer(&[form.tensor(&crop.picture, mirrored)])?;
        let card = network.card();
        let [width, height] = [card.output.width, card.output.height].map(|side| side as usize);
        let cell = card.cell_to_input;
        let peak = |map: &[f32]| {
            let (cells, height) = peak_of(map, width);
            Peak {
                at_px: cells * cell.scale + Vector2::repeat(cell.offset),
                height,
            }
        };
        found.push(maps.chunks_exact(width * height).map(peak).collect());
    }
    Ok(found)
}

/// The centre of the highest place of a map, cells, and its height.
fn peak_of(map: &[f32], width: usize) -> (Vector2<f64>, f32) {
    const REACH: usize = 2;
    let (highest, value) = map
        .iter()
        .enumerate()
        .fold((0, f32::MIN), |best, (at, &value)| {
            if value > best.1 { (at, value) } else { best }
        });
    let [column, row] = [highest % width, highest / width];
    let rows = row.saturating_sub(REACH)..(row + REACH + 1).min(map.len() / width);
    let columns = column.saturating_sub(REACH)..(column + REACH + 1).min(width);
    let near = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
    let (sum, total) = near.fold((Vector2::zeros(), 0.0), |(sum, total), (x, y)| {
        let weight = f64::from(map[y * width + x].max(0.0)).powi(2);
        (
            sum + Vector2::new(x as f64, y as f64) * weight,
            total + weight,
        )
    });
    let centre = Vector2::new(column as f64, row as f64);
    (if total > 0.0 { sum / total } else { centre }, value)
}

impl InputForm {
    fn tensor(&self, picture: &RgbImage, mirrored: bool) -> InputTensor {
        let Normalize { scale, mean, std } = &self.normalize;
        let (width, height) = picture.dimensions();
        let values = (0..3).flat_map(|channel| {
            let colour = match self.channels {
                Channels::Rgb => channel,
                Channels::Bgr => 2 - channel,
            };
            (0..height).flat_map(move |y| {
                (0..width).map(move |x| {
                    let x = if mirrored { width - 1 - x } else { x };
                    let value = f32::from(picture.get_pixel(x, y).0[colour]);
                    (value * scale - mean[channel]) / std[channel]
                })
            })
        });
        InputTensor {
            values: values.collect(),
        }
    }

    /// The usual forms, in both orders of colours.
    fn usual() -> Vec<Self> {
        let byte = 1.0 / 255.0;
        let forms = [
            ("0 to 1", byte, [0.0; 3], [1.0; 3]),
            ("-1 to 1", byte, [0.5; 3], [0.5; 3]),
            ("0 to 255", 1.0, [0.0; 3], [1.0; 3]),
            (
                "ImageNet's mean and deviation",
                byte,
                [0.485, 0.456, 0.406],
                [0.229, 0.224, 0.225],
            ),
        ];
        let reversed = |[a, b, c]: [f32; 3]| [c, b, a];
        let both = forms.into_iter().flat_map(|(name, scale, mean, std)| {
            let form = |order: &str, channels, mean, std| Self {
                name: format!("{order}, {name}"),
                channels,
                normalize: Normalize { scale, mean, std },
            };
            [
                form("rgb", Channels::Rgb, mean, std),
                form("bgr", Channels::Bgr, reversed(mean), reversed(std)),
            ]
        });
        both.collect()
    }

    /// Whether black or white pixels have other numbers.
    fn differs_from(&self, other: &Self) -> bool {
        const SAME: f32 = 0.05;
        let ends = |form: &Self| {
            let Normalize { scale, mean, std } = &form.normalize;
            [0.0, 255.0].map(|value| [0, 1, 2].map(|c| (value * scale - mean[c]) / std[c]))
        };
        let (own, others) = (ends(self), ends(other));
        let pairs = own.iter().flatten().zip(others.iter().flatten());
        self.channels != other.channels
            || pairs
                .into_iter()
                .any(|(a, b)| (a - b).abs() > SAME * a.abs().max(1.0))
    }
}

/// Distances of limbs from the truth, shares of the person's height.
fn errors(crops: &[RenderedCrop], found: &[Vec<Peak>], maps: &[usize]) -> Vec<f64> {
    let each = crops.iter().zip(found).flat_map(|(crop, peaks)| {
        let pairs = maps.iter().zip(&crop.limbs_px);
        pairs.map(|(&map, truth)| (peaks[map].at_px - truth).norm() / crop.height_px)
    });
    each.collect()
}

/// By crop, how well the network sees the person: the mean of height times nearness of the limbs.
fn qualities(crops: &[RenderedCrop], found: &[Vec<Peak>], maps: &[usize]) -> Vec<f64> {
    let off = errors(crops, found, maps);
    let by_crop = off.chunks_exact(maps.len()).zip(found);
    let quality = |(off, peaks): (&[f64], &Vec<Peak>)| {
        let limbs = maps.iter().zip(off);
        let each =
            limbs.map(|(&map, off)| f64::from(peaks[map].height.min(1.0)) * (-off / LOST).exp());
        each.sum::<f64>() / maps.len() as f64
    };
    by_crop.map(quality).collect()
}

/// Another form of the input that the network sees better, in words.
fn better_form(
    network: &mut OnnxKeypointNetwork,
    crops: &[RenderedCrop],
    own: &InputForm,
    found: &[Vec<Peak>],
    maps: &[usize],
) -> anyhow::Result<Option<String>> {
    let before = qualities(crops, found, maps);
    let mut best: Option<(f64, String)> = None;
    for form in InputForm::usual()
        .into_iter()
        .filter(|form| form.differs_from(own))
    {
        let other = peaks(network, crops, &form, false)?;
        let after = qualities(crops, &other, maps);
        let wins = after
            .iter()
            .zip(&before)
            .filter(|(after, before)| after > before)
            .count();
        if (wins as f64) < BETTER_SHARE * crops.len() as f64 {
            continue;
        }
        let mean = after.iter().sum::<f64>() / after.len().max(1) as f64;
        if best.as_ref().is_none_or(|(highest, _)| mean > *highest) {
            let distances = [found, &other].map(|it| 100.0 * median(errors(crops, it, maps)));
            best = Some((
                mean,
                format!(
                    "as {} it sees {wins} of {} rendered people better: keypoints {:.1} % of their height from the truth instead of {:.1}",
                    form.name,
                    crops.len(),
                    distances[1],
                    distances[0]
                ),
            ));
        }
    }
    Ok(best.map(|(_, text)| text))
}

/// Maps that show another limb than the card says, in words.
fn wrong_order(crops: &[RenderedCrop], found: &[Vec<Peak>], maps: &[usize]) -> Option<String> {
    const SHOWN: usize = 4;
    let distance = |map: usize, limb: usize| {
        let each = crops.iter().zip(found);
        median(
            each.map(|(crop, peaks)| {
                (peaks[map].at_px - crop.limbs_px[limb]).norm() / crop.height_px
            })
            .collect(),
        )
    };
    let wrong = maps.iter().enumerate().filter_map(|(limb, &map)| {
        let own = distance(map, limb);
        let others = (0..LIMB_POINTS.len()).map(|other| (distance(map, other), other));
        let (nearest, other) = others.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let is_wrong = other != limb && nearest * NEARER < own && nearest < LOST;
        is_wrong.then(|| {
            format!(
                "map {map} (`{}`) shows {}",
                LIMB_POINTS[limb], LIMB_POINTS[other]
            )
        })
    });
    let wrong: Vec<String> = wrong.collect();
    let dots = if wrong.len() > SHOWN { ", ..." } else { "" };
    let first: Vec<&str> = wrong.iter().take(SHOWN).map(String::as_str).collect();
    (!wrong.is_empty()).then(|| format!("{} of 12 limbs: {}{dots}", wrong.len(), first.join(", ")))
}

/// An offset of cells that differs from the card's, in words.
///
/// In the mirrored crop a keypoint is where its partner was: both places add up to the width. This
/// needs no truth; a wrong offset is in both.
fn wrong_offset(
    card: &HeatmapCard,
    found: &[Vec<Peak>],
    mirrored: &[Vec<Peak>],
    maps: &[usize],
) -> Option<String> {
    let last_px = f64::from(card.input.width) - 1.0;
    let pairs = found.iter().zip(mirrored).flat_map(|(found, mirrored)| {
        // Left and right alternate.
        maps.iter().enumerate().filter_map(|(limb, &map)| {
            let (peak, partner) = (found[map], mirrored[maps[limb ^ 1]]);
            let is_seen = peak.height.min(partner.height) >= LEAST_HEIGHT;
            is_seen.then(|| 0.5 * (peak.at_px.x + partner.at_px.x - last_px))
        })
    });
    let off_px = median(pairs.collect());
    let cell = card.cell_to_input;
    (off_px.abs() > OFFSET_CELLS * cell.scale).then(|| {
        format!(
            "keypoints of crops and of mirrored crops do not fit with an `offset` of {:.2} input pixels, but with about {:.1}",
            cell.offset,
            cell.offset - off_px
        )
    })
}

/// The median; 0 of nothing.
fn median(values: Vec<f64>) -> f64 {
    upper_median(values).unwrap_or(0.0)
}
