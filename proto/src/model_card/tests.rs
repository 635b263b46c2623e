//! Model cards of both kinds, and the errors of invalid ones.

use super::*;

const HEATMAP: &str = r#"kind = "heatmap"
file = "net.onnx"
input = { name = "image", layout = "nchw", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 0.004, mean = [0.485, 0.456, 0.406], std = [0.229, 0.224, 0.225] }
output = { name = "heatmaps", width = 48, height = 64, keypoints = "coco17" }
cell_to_input = { scale = 4.0, offset = 0.0 }
box_margin = 1.25
keypoint_offsets = { left_hip = [0.0, 0.03, -0.02] }
"#;

const DETECTOR: &str = r#"kind = "detector"
file = "det.onnx"
decode = "yolox"
input = { name = "images", width = 416, height = 416, channels = "bgr", letterbox = "top-left", pad = 114 }
normalize = { scale = 1.0, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }
output = { name = "output", person_class = 0 }
"#;

fn parse(text: &str) -> Result<ModelCard, FileError> {
    ModelCard::parse(text, Path::new("models/card.toml"))
}

fn refusal(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from));
    parse(&text.replace(from, to)).unwrap_err().to_string()
}

#[test]
fn a_heatmap_card_is_read() {
    let card = HeatmapCard::parse(HEATMAP, Path::new("models/card.toml")).unwrap();
    assert_eq!(card.file, Path::new("models/net.onnx"));
    assert_eq!(
        (card.input.channels, card.input.letterbox),
        (Channels::Rgb, None)
    );
    assert_eq!(
        (
            card.output.width,
            card.output.height,
            card.output.keypoints.len()
        ),
        (48, 64, 17)
    );
    assert_eq!(card.keypoint_offsets.len(), 1);
}

#[test]
fn the_peak_sigma_has_a_default() {
    let sigma_cells = |text: &str| {
        let card = HeatmapCard::parse(text, Path::new("models/card.toml")).unwrap();
        card.output.peak_sigma_of_width() * f64::from(card.output.width)
    };
    assert!((sigma_cells(HEATMAP) - 2.0).abs() < 1e-12);
    let stated = HEATMAP.replace("height = 64,", "height = 64, peak_sigma_cells = 1.5,");
    assert!((sigma_cells(&stated) - 1.5).abs() < 1e-12);
    assert_eq!(
        refusal(
            HEATMAP,
            "height = 64,",
            "height = 64, peak_sigma_cells = 0.0,"
        ),
        "models/card.toml:5: `output.peak_sigma_cells`: found 0, expected a number from 0.1 to 256"
    );
}

#[test]
fn a_simcc_card_gives_its_tensors_and_its_cells() {
    let tensors = r#"simcc = { x = "simcc_x", y = "simcc_y", bins_per_pixel = 2 }"#;
    let text = HEATMAP.replace("name = \"heatmaps\"", tensors);
    let cells = "cell_to_input = { scale = 4.0, offset = 0.0 }\n";
    let card = HeatmapCard::parse(&text.replace(cells, ""), Path::new("card.toml")).unwrap();
    assert!(matches!(card.output.tensors, HeatmapTensors::Simcc(it) if it.y == "simcc_y"));
    // Eight bins in a cell: the centre of the first cell is bin 3.5.
    let CellToInput { scale, offset } = card.cell_to_input;
    assert!((scale - 4.0).abs() < 1e-12 && (offset - 1.75).abs() < 1e-12);
    let error = |text: &str| parse(text).unwrap_err().to_string();
    assert!(error(&text).contains("`cell_to_input`: expected no such field"));
    assert!(error(&HEATMAP.replace(cells, "")).contains("`cell_to_input`: the field is missing"));
    let both = text.replace("simcc = ", "name = \"maps\", simcc = ");
    assert!(error(&both).contains("found both"));
    let flat = text
        .replace(cells, "")
        .replace("height = 64", "height = 63");
    assert!(error(&flat).contains("`output.height`: found 48 x 63 cells"));
    let none = text.replace("bins_per_pixel = 2", "bins_per_pixel = 0");
    assert!(error(&none).contains("`output.simcc.bins_per_pixel`"));
}

#[test]
fn a_detector_card_is_read() {
    let card = DetectorCard::parse(DETECTOR, Path::new("models/card.toml")).unwrap();
    assert_eq!((card.decode, card.output.person_class), (Decode::Yolox, 0));
    assert_eq!(
        (card.input.letterbox, card.input.pad),
        (Some(Letterbox::TopLeft), Some(114))
    );
}

#[test]
fn a_list_of_keypoints_is_read() {
    let text = HEATMAP.replace("\"coco17\"", "[\"left_hip\", \"left_heel\"]");
    let ModelCard::Heatmap(card) = parse(&text).unwrap() else {
        panic!("a heatmap card")
    };
    assert_eq!(card.output.keypoints.index_of("left_heel"), Some(1));
}

#[test]
fn a_card_of_the_other_kind_is_refused() {
    let refused = HeatmapCard::parse(DETECTOR, Path::new("d.toml"))
        .unwrap_err()
        .to_string();
    assert_eq!(
        refused,
        "d.toml: `kind`: found \"detector\", expected \"heatmap\""
    );
}

#[test]
fn errors_name_field_and_line() {
    let check = |text, from, to, expected: &str| {
        assert_eq!(
            refusal(text, from, to),
            format!("models/card.toml:{expected}")
        );
    };
    check(
        HEATMAP,
        "\"heatmap\"",
        "\"heat\"",
        "1: `kind`: unknown kind `heat`, expected one of `heatmap`, `detector`",
    );
    check(
        HEATMAP,
        "\"nchw\"",
        "\"nhwc\"",
        "3: `input.layout`: found \"nhwc\", expected \"nchw\", the only layout that is read",
    );
    check(
        HEATMAP,
        "width = 48",
        "width = 480",
        "5: `output.width`: found 480, expected 1 to 256 cells",
    );
    check(
        HEATMAP,
        "coco17",
        "coco18",
        "5: `output.keypoints`: found \"coco18\", expected \"coco17\", or with feet \"coco23\" or \"halpe26\", or a list of names",
    );
    check(
        HEATMAP,
        "box_margin",
        "box_margins",
        "7: `box_margins`: unknown field `box_margins`, did you mean `box_margin`?",
    );
    check(
        HEATMAP,
        "1.25",
        "nan",
        "7: `box_margin`: found NaN, expected a number from 1 to 2",
    );
    check(
        HEATMAP,
        "left_hip",
        "left_hips",
        "8: `keypoint_offsets.left_hips`: unknown keypoint `left_hips`, did you mean `left_hip`?",
    );
    check(
        HEATMAP,
        "0.229",
        "0.0",
        "4: `normalize.std[0]`: found 0, expected a number from 0.000001 to 1000000",
    );
    check(
        DETECTOR,
        "\"yolox\"",
        "\"yolo\"",
        "3: `decode`: unknown value `yolo`, did you mean `yolox`?",
    );
    check(
        DETECTOR,
        "pad = 114",
        "pad = 300",
        "4: `input.pad`: found integer `300`, expected u8",
    );
}

#[test]
fn cells_that_do_not_lie_in_the_input_are_refused() {
    let scale = |to| refusal(HEATMAP, "scale = 4.0", to);
    assert_eq!(
        scale("scale = 3.0"),
        "models/card.toml:6: `cell_to_input.scale`: found 3, with which 48 cells are 144 pixels wide, expected 4: the input is 192 pixels wide"
    );
    let turned = refusal(
        HEATMAP,
        "width = 48, height = 64",
        "width = 64, height = 48",
    );
    assert!(turned.contains("64 cells are 256 pixels wide"), "{turned}");
    let offset = refusal(HEATMAP, "offset = 0.0", "offset = 8.0");
    assert!(
        offset.contains("found 8, expected a number from -4 to 4"),
        "{offset}"
    );
    // From the centre of the first pixel to that of the last, and with half a cell more.
    for (from, to) in [
        ("scale = 4.0", "scale = 4.06"),
        ("offset = 0.0", "offset = 1.5"),
    ] {
        parse(&HEATMAP.replace(from, to)).unwrap();
    }
}

#[test]
fn mean_and_deviation_for_another_pixel_scale_are_refused() {
    let of_whole_pixels = "mean = [123.7, 116.3, 103.5], std = [58.4, 57.1, 57.4]";
    let of_shares = "mean = [0.485, 0.456, 0.406], std = [0.229, 0.224, 0.225]";
    let scale = |scale: &str| HEATMAP.replace("scale = 0.004", scale);
    let both = |text: &str| text.replace(of_shares, of_whole_pixels);
    parse(&both(&scale("scale = 1.0"))).unwrap();
    for (text, white) in [
        (scale("scale = 1.0"), "a white one 1111."),
        (both(&scale("scale = 0.0039")), "a white one -2.101"),
    ] {
        let refused = parse(&text).unwrap_err().to_string();
        assert!(
            refused.starts_with("models/card.toml:4: `normalize`: a black pixel"),
            "{refused}"
        );
        assert!(refused.contains(white), "{refused}");
    }
}

#[test]
fn a_missing_card_of_an_installed_network_has_a_remedy() {
    let missing = io::Error::from(ErrorKind::NotFound);
    let installed = unread_card(&missing, Path::new("networks/net/net.toml"));
    assert!(
        installed.contains("`farfield networks install net`"),
        "{installed}"
    );
    let other = unread_card(&missing, Path::new("models/net.toml"));
    assert_eq!(other, missing.to_string());
    let folder = io::Error::from(ErrorKind::IsADirectory);
    let problem = unread_card(&folder, Path::new("net/net.toml"));
    assert!(problem.contains("found a folder"), "{problem}");
}
