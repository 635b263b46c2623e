//! Short recordings made by each test: complete, cut, rotated, and with other sizes and rates.

use std::path::PathBuf;
use std::process::Command;

use image::RgbImage;

use super::*;
use crate::source::{FieldOrder, HdrTransfer, VideoFormat};

const SIZE_PX: [u32; 2] = [96, 64];
const FRAMES: usize = 24;

fn expected() -> ExpectedSource {
    ExpectedSource {
        at: SourceOrigin {
            camera: "left".to_owned(),
            place: "videos/left.mp4".to_owned(),
        },
        size_px: SIZE_PX,
        rate_hz: 30.0,
        first_tick: Tick(100),
        keypoints: 17,
        tick_from: TickFrom::Clock,
    }
}

/// Where recordings are made; `None`, with a line on standard output, if ffmpeg is not installed.
fn studio() -> Option<Studio> {
    if ffmpeg_sidecar::command::ffmpeg_is_installed() {
        return Some(Studio(tempfile::tempdir().unwrap()));
    }
    println!("skipped: ffmpeg is not installed");
    None
}

struct Studio(tempfile::TempDir);

impl Studio {
    /// Runs ffmpeg with `args` and writes to `name`.
    fn record(&self, args: &str, name: &str) -> PathBuf {
        let path = self.0.path().join(name);
        let done = Command::new("ffmpeg")
            .args(["-nostdin", "-v", "error", "-y"])
            .args(args.split_whitespace())
            .arg(&path)
            .current_dir(self.0.path())
            .status()
            .unwrap();
        assert!(done.success(), "ffmpeg {args} {name}");
        path
    }

    /// A lossless recording of [`FRAMES`] frames at 30 Hz with its index at the start.
    fn clip(&self) -> PathBuf {
        self.record(
            "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -c:v png -movflags +faststart",
            "clip.mp4",
        )
    }

    /// The first `share` of the bytes of `path`.
    fn cut(&self, path: &Path, share: f64) -> PathBuf {
        let bytes = std::fs::read(path).unwrap();
        let cut = self
            .0
            .path()
            .join(format!("cut-{}", path.file_name().unwrap().display()));
        std::fs::write(&cut, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
        cut
    }

    /// The pictures of the generator, frame by frame.
    fn truth(&self) -> Vec<RgbImage> {
        self.record(
            "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -pix_fmt rgb24",
            "%d.png",
        );
        (1..=FRAMES)
            .map(|n| {
                image::open(self.0.path().join(format!("{n}.png")))
                    .unwrap()
                    .into_rgb8()
            })
            .collect()
    }
}

fn images(mut source: impl FrameSource) -> Vec<(i64, RgbImage)> {
    std::iter::from_fn(|| source.next_frame().unwrap())
        .map(|frame| match frame.content {
            FrameContent::Image(picture) => (frame.tick.0, picture.into_rgb()),
            FrameContent::Keypoints(_) | FrameContent::Painted(_) => {
                panic!("an image was asked for")
            }
        })
        .collect()
}

fn refusal(path: &Path) -> SourceError {
    let error = probe(path, &expected()).unwrap_err();
    let message = error.to_string();
    assert!(
        message.starts_with("videos/left.mp4: camera `left`: "),
        "{message}"
    );
    error
}

#[test]
fn a_timecode_gives_the_first_tick_if_the_venue_uses_it() {
    let Some(studio) = studio() else { return };
    let by_timecode = ExpectedSource {
        tick_from: TickFrom::Timecode,
        ..expected()
    };
    let path = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -c:v mpeg4 -timecode 01:00:00:10",
        "coded.mov",
    );
    let first = Tick(108_010);
    assert_eq!(
        probe(&path, &by_timecode).unwrap().ticks,
        Some(first..first + 24)
    );
    assert_eq!(
        probe(&path, &expected()).unwrap().ticks,
        Some(Tick(100)..Tick(124))
    );
    let mut source = open(&path, by_timecode.clone(), first + 3).unwrap();
    assert_eq!(source.next_frame().unwrap().unwrap().tick, first + 3);
    let error = probe(&studio.clip(), &by_timecode).unwrap_err();
    assert!(matches!(error, SourceError::Timecode { .. }), "{error}");
}

#[test]
fn every_frame_comes_once_and_unchanged() {
    let Some(studio) = studio() else { return };
    let clip = studio.clip();
    let info = probe(&clip, &expected()).unwrap();
    assert_eq!(info.ticks, Some(Tick(100)..Tick(124)));
    assert_eq!((info.size_px, info.rate_hz), (Some(SIZE_PX), Some(30.0)));
    let got = images(open(&clip, expected(), Tick(100)).unwrap());
    let truth: Vec<_> = (100..).zip(studio.truth()).collect();
    assert!(got == truth, "{} of {} frames", got.len(), truth.len());
}

#[test]
fn a_run_from_the_middle_starts_at_exactly_that_frame() {
    let Some(studio) = studio() else { return };
    // Compressed with references between frames: seeking by key frames would not be exact.
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -c:v mpeg4 -g 12 -bf 2 -q:v 2",
        "clip.mp4",
    );
    let whole = images(open(&clip, expected(), Tick(100)).unwrap());
    let rest = images(open(&clip, expected(), Tick(117)).unwrap());
    assert!(rest == whole[17..], "{} frames", rest.len());
    assert!(matches!(
        open(&clip, expected(), Tick(124)),
        Err(SourceError::OutsideClip { .. })
    ));
    assert!(matches!(
        open(&clip, expected(), Tick(99)),
        Err(SourceError::OutsideClip { .. })
    ));
}

#[test]
fn a_video_cut_in_the_middle_is_refused_before_the_first_tick() {
    let Some(studio) = studio() else { return };
    let mkv = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -c:v png",
        "a.mkv",
    );
    for (clip, announced) in [(studio.clip(), 24), (mkv, 23)] {
        let error = refusal(&studio.cut(&clip, 0.6));
        let is_cut = matches!(error, SourceError::Cut { announced: n, .. } if n == announced);
        assert!(is_cut, "{error}");
    }
    let without_index = studio.record("-i clip.mp4 -c copy", "plain.mp4");
    let error = refusal(&studio.cut(&without_index, 0.6));
    assert!(matches!(error, SourceError::Unreadable { .. }), "{error}");
    assert!(error.to_string().contains("moov atom not found"), "{error}");
}

#[test]
fn a_recording_that_shrinks_after_the_probe_does_not_end_quietly() {
    let Some(studio) = studio() else { return };
    let cut = studio.cut(&studio.clip(), 0.6);
    let wanted = Wanted::After(0, VideoFormat::default());
    let decoded = Ffmpeg::spawn(ffmpeg::file_input(&cut), wanted, &expected().at);
    let mut source =
        VideoSource::new(decoded.unwrap(), expected(), Tick(100), WhenFull::Wait).unwrap();
    source.expected = Some(FRAMES as u64);
    let error = loop {
        match source.next_frame() {
            Ok(frame) => assert!(frame.is_some(), "ended quietly"),
            Err(error) => break error,
        }
    };
    let expected = Some(FRAMES as u64);
    let is_early = matches!(error, SourceError::Ended { expected: n, .. } if n == expected);
    assert!(is_early, "{error}");
    assert_eq!(source.next_frame(), Ok(None));
}

#[test]
fn another_pixel_size_is_refused_with_both_sizes() {
    let Some(studio) = studio() else { return };
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=64x96:rate=30 -frames:v 3",
        "a.mp4",
    );
    let error = refusal(&clip);
    let SourceError::PixelSize {
        found_px,
        expected_px,
        ..
    } = error
    else {
        panic!("{error}")
    };
    assert_eq!((found_px, expected_px), ([64, 96], SIZE_PX));
}

#[test]
fn a_phone_video_has_the_size_it_is_decoded_to() {
    let Some(studio) = studio() else { return };
    studio.record(
        "-f lavfi -i testsrc2=size=64x96:rate=30 -frames:v 3 -c:v mpeg4",
        "upright.mp4",
    );
    let turned = studio.record(
        "-i upright.mp4 -c copy -metadata:s:v:0 rotate=90",
        "turned.mp4",
    );
    let size_px = ffprobe::read_stream(&turned, &expected().at)
        .unwrap()
        .size_px;
    if size_px == [64, 96] {
        println!("skipped: this ffmpeg does not write rotation that way");
        return;
    }
    assert_eq!(size_px, SIZE_PX);
    assert_eq!(
        images(open(&turned, expected(), Tick(100)).unwrap()).len(),
        3
    );
}

/// A bar that moves by one pixel per field, so the two fields of a picture show it at two places.
const INTERLACED: &str = "-f lavfi -i color=black:size=96x64:rate=60 \
                          -vf geq=lum=16+219*between(X\\,N\\,N+12):cb=128:cr=128,tinterlace=interleave_top,setfield=tff \
                          -frames:v 24 -c:v mpeg2video -q:v 1 -flags +ilme+ildct -top 1";

/// Mean difference of neighbouring lines: moving content differs in interlaced pictures.
fn combs(image: &RgbImage) -> f64 {
    let rows = 0..image.height() - 1;
    let each = rows.flat_map(|y| (0..image.width()).map(move |x| (x, y)));
    let each = each.map(|(x, y)| {
        let (a, b) = (image.get_pixel(x, y).0, image.get_pixel(x, y + 1).0);
        f64::from(a[1].abs_diff(b[1]))
    });
    each.sum::<f64>() / f64::from(image.width() * image.height())
}

#[test]
fn interlaced_pictures_are_deinterlaced_one_for_one() {
    let Some(studio) = studio() else { return };
    let clip = studio.record(INTERLACED, "fields.mkv");
    let info = probe(&clip, &expected()).unwrap();
    assert_eq!(info.format.field_order, Some(FieldOrder::TopFirst));
    let whole = images(open(&clip, expected(), Tick(100)).unwrap());
    assert_eq!(whole.len(), FRAMES);
    let stored = studio.record("-i fields.mkv -frames:v 5 -pix_fmt rgb24", "%d.png");
    let stored = image::open(stored.with_file_name("5.png")).unwrap();
    let (before, after) = (combs(&stored.into_rgb8()), combs(&whole[4].1));
    assert!(before > 5.0 && after < 0.2, "{before} {after}");
    // The bar of picture 4 in its first field, which is field 8.
    let row = |x: u32| whole[4].1.get_pixel(x, 30).0[1];
    assert!(row(7) < 64 && row(8) > 192, "{} {}", row(7), row(8));
    let fields = ExpectedSource {
        rate_hz: 60.0,
        ..expected()
    };
    let error = probe(&clip, &fields).unwrap_err();
    let is_interlaced =
        matches!(error, SourceError::Fields { found_hz, .. } if (found_hz - 30.0).abs() < 1e-3);
    assert!(is_interlaced, "{error}");
    let rest = images(open(&clip, expected(), Tick(117)).unwrap());
    assert!(rest == whole[17..], "{} frames", rest.len());
}

#[test]
fn high_dynamic_range_is_tone_mapped_and_less_pale() {
    let Some(studio) = studio() else { return };
    if !ffmpeg::has_filter("zscale") {
        println!("skipped: this ffmpeg has no filter zscale");
        return;
    }
    // Paper white of HLG is three quarters of its range: 722 of 64 to 940 in ten bits.
    let clip = studio.record(
        "-f lavfi -i color=black:size=96x64:rate=30 -frames:v 3 -vf format=yuv420p10le,geq=lum=722:cb=512:cr=512 -c:v ffv1 \
         -color_trc arib-std-b67 -color_primaries bt2020 -colorspace bt2020nc",
        "paper.mkv",
    );
    let info = probe(&clip, &expected()).unwrap();
    assert_eq!(info.format.hdr, Some(HdrTransfer::Hlg));
    let read = images(open(&clip, expected(), Tick(100)).unwrap());
    let [r, g, b] = read[1].1.get_pixel(48, 32).0;
    // Without tone mapping it is 190.
    assert!(read.len() == 3 && r.min(g).min(b) > 205, "{r} {g} {b}");
}

#[test]
fn pixels_that_are_not_square_are_read_from_the_container() {
    let Some(studio) = studio() else { return };
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 3 -vf setsar=4/3 -c:v mpeg4",
        "wide.mp4",
    );
    let info = probe(&clip, &expected()).unwrap();
    assert_eq!(info.format.pixel_aspect, Some([4, 3]));
    assert_eq!(info.format.field_order, None);
    assert_eq!(images(open(&clip, expected(), Tick(100)).unwrap()).len(), 3);
}

#[test]
fn pictures_of_both_ranges_are_read_alike() {
    let Some(studio) = studio() else { return };
    let pixel = |format: &str, range: &str, level: u8| {
        let args = format!(
            "-f lavfi -i color=black:size=96x64:rate=30 -frames:v 1 -vf format={format},geq=lum={level}:cb=128:cr=128 -c:v ffv1 \
             -color_range {range}"
        );
        let clip = studio.record(&args, "range.mkv");
        images(open(&clip, expected(), Tick(100)).unwrap())[0]
            .1
            .get_pixel(4, 4)
            .0[0]
    };
    // Half of 0 to 255, and of 16 to 235.
    let (full, limited) = (pixel("yuvj420p", "pc", 128), pixel("yuv420p", "tv", 126));
    assert!(full.abs_diff(limited) <= 2, "{full} {limited}");
}

#[test]
fn colours_match_ffmpeg_for_every_matrix() {
    let Some(studio) = studio() else { return };
    // Soft colours, because ffmpeg does not interpolate chroma.
    let drawn = "-f lavfi -i gradients=s=96x64:r=30:c0=orange:c1=navy:x0=0:y0=0:x1=95:y1=63:nb_colors=2:seed=1 -frames:v 1";
    for (pixels, matrix) in [
        ("yuv420p", "bt709"),
        ("yuv420p", "smpte170m"),
        ("yuvj422p", "bt470bg"),
        ("yuv444p", "bt2020nc"),
    ] {
        let args = format!(
            "{drawn} -vf scale=out_color_matrix={},format={pixels} -colorspace {matrix} -c:v ffv1",
            matrix.trim_end_matches("nc")
        );
        let clip = studio.record(&args, "colours.mkv");
        let read = images(open(&clip, expected(), Tick(100)).unwrap());
        let shown = studio.record("-i colours.mkv -frames:v 1 -pix_fmt rgb24", "shown.png");
        let shown = image::open(shown).unwrap().into_rgb8();
        let apart = read[0].1.iter().zip(shown.iter());
        let worst = apart.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(worst <= 4, "{pixels} {matrix}: {worst}");
    }
}

#[test]
fn errors_do_not_contain_the_password_of_a_camera() {
    let Some(_studio) = studio() else { return };
    let url = "http://admin:geheim-42@127.0.0.1:1/video?token=t0ken&channel=3";
    let mut source = open_live(url, &BTreeMap::new(), true, expected(), Tick(7)).unwrap();
    let error = source.next_frame().unwrap_err().to_string();
    let is_redacted =
        error.contains("channel=3") && !error.contains("geheim") && !error.contains("t0ken");
    assert!(is_redacted, "{error}");
}

#[test]
fn another_rate_is_refused_with_both_rates() {
    let Some(studio) = studio() else { return };
    let record = |rate: &str| {
        let args = format!("-f lavfi -i testsrc2=size=96x64:rate={rate} -frames:v 30");
        studio.record(&args, "rate.mp4")
    };
    let error = refusal(&record("25"));
    let SourceError::Rate {
        found_hz,
        expected_hz,
        ..
    } = error
    else {
        panic!("{error}")
    };
    assert!((found_hz - 25.0).abs() < 1e-3, "{found_hz}");
    assert!((expected_hz - 30.0).abs() < 1e-9, "{expected_hz}");
    assert!(probe(&record("30000/1001"), &expected()).is_ok());
}

#[test]
fn a_variable_rate_is_refused_with_the_frame() {
    let Some(studio) = studio() else { return };
    // Frame 5 is missing, and the last frames come faster, so that the mean rate is kept.
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 20 \
         -vf setpts=(N+gt(N\\,4)-0.3*gte(N\\,18)-0.7*gte(N\\,19))/30/TB -fps_mode passthrough",
        "variable.mkv",
    );
    let error = refusal(&clip);
    let is_variable = matches!(error, SourceError::VariableRate { before: 4, .. });
    assert!(is_variable, "{error}");
    // A caller that needs only pictures gets all of them.
    let (info, source) = open_alone(&clip).unwrap();
    assert_eq!(info.size_px, Some(SIZE_PX));
    let alone = images(source);
    assert_eq!(info.ticks, Some(Tick(0)..Tick(20)));
    assert_eq!((alone.len(), alone[0].0), (20, 0));
}

#[test]
fn lost_frames_are_reported_as_lost() {
    let Some(studio) = studio() else { return };
    let record = |rate: u8, lost: u8, name: &str| {
        let args = format!(
            "-f lavfi -i testsrc2=size=96x64:rate={rate} -frames:v 80 -vf setpts=(N+{lost}*gt(N\\,29))/{rate}/TB -fps_mode passthrough"
        );
        refusal(&studio.record(&args, name))
    };
    // Ten of ninety are lost: 27 frames per second. The others must not be converted to that rate.
    let error = record(30, 10, "lost.mkv");
    let is_lost = matches!(error, SourceError::VariableRate { before: 29, .. });
    assert!(is_lost, "{error}");
    assert!(error.to_string().contains("-r 30 OUT"), "{error}");
    // A recording at 25 per second has that rate, whatever it lost.
    let error = record(25, 1, "slower.mkv");
    let is_slower =
        matches!(error, SourceError::Rate { found_hz, .. } if (found_hz - 25.0).abs() < 1e-3);
    assert!(is_slower, "{error}");
}

#[test]
fn a_rate_that_falls_does_not_make_a_recording_look_cut() {
    let Some(studio) = studio() else { return };
    // Twenty frames at 30 Hz and four of half a second each, as from a phone in the dark.
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -vf setpts=(N+14*max(0\\,N-19))/30/TB -fps_mode passthrough",
        "falling.mkv",
    );
    let (info, source) = open_alone(&clip).unwrap();
    assert_eq!(images(source).len(), 24);
    // 23 intervals in 2.63 s.
    let rate_hz = info.rate_hz.unwrap();
    assert!((8.0..10.0).contains(&rate_hz), "{rate_hz}");
}

#[test]
fn edit_lists_shorten_a_recording_and_are_counted() {
    let Some(studio) = studio() else { return };
    studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 24 -c:v mpeg4 -g 24 -bf 0",
        "whole.mp4",
    );
    let trimmed = studio.record("-ss 0.2 -i whole.mp4 -c copy", "trimmed.mp4");
    let ticks = probe(&trimmed, &expected()).unwrap().ticks.unwrap();
    let decoded = images(open(&trimmed, expected(), Tick(100)).unwrap());
    assert_eq!(ticks, Tick(100)..Tick(decoded[decoded.len() - 1].0 + 1));
}

#[test]
fn files_that_hold_no_video_are_refused_by_name() {
    let Some(studio) = studio() else { return };
    let path = studio.0.path().join("x.mp4");
    assert!(matches!(refusal(&path), SourceError::NotThere { .. }));
    let unreadable = |path: &Path| {
        let error = refusal(path);
        assert!(matches!(error, SourceError::Unreadable { .. }), "{error}");
        error.to_string()
    };
    for bytes in [&b""[..], b"no video at all", &[0; 5000]] {
        std::fs::write(&path, bytes).unwrap();
        unreadable(&path);
    }
    std::fs::write(&path, b"").unwrap();
    assert!(unreadable(&path).contains("0 bytes"));
    let sound = studio.record("-f lavfi -i sine=duration=0.2", "sound.wav");
    assert!(unreadable(&sound).contains("video stream"));
    unreadable(studio.0.path());
}

#[test]
fn a_missing_program_is_reported_with_install_commands() {
    let error = ffmpeg::start_problem(
        &expected().at,
        "ffmpeg",
        &std::io::ErrorKind::NotFound.into(),
    );
    assert!(
        error.to_string().contains("`apt install ffmpeg`"),
        "{error}"
    );
}

#[test]
fn a_live_source_counts_arrivals_and_its_end_is_an_error() {
    let Some(_studio) = studio() else { return };
    let url = "lavfi:testsrc2=size=96x64:rate=30:duration=0.5";
    assert_eq!(probe_live(url, &expected()).unwrap(), SourceInfo::default());
    let mut source = open_live(url, &BTreeMap::new(), true, expected(), Tick(7)).unwrap();
    let mut last = Tick(6);
    let problem = loop {
        match source.next_frame() {
            Ok(frame) => {
                let tick = frame.expect("a live source never ends quietly").tick;
                assert!(tick > last);
                last = tick;
            }
            Err(problem) => break problem,
        }
    };
    assert!(
        matches!(problem, SourceError::Ended { expected: None, .. }),
        "{problem}"
    );
    // 15 frames, with or without the one that ffmpeg analyses before it starts.
    assert!(
        (Tick(20)..=Tick(21)).contains(&last),
        "the newest frame is never the one that is lost: {last}"
    );
}

#[test]
fn pictures_of_a_stream_have_the_times_of_the_stream() {
    /// Rounding of 90 kHz clocks, downwards.
    const ROUNDING_US: i64 = 12;
    let Some(_studio) = studio() else { return };
    let port = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    let url = format!("rtp://127.0.0.1:{}", port.unwrap().port());
    let mut source = open_live(&url, &BTreeMap::new(), true, expected(), Tick(0)).unwrap();
    let words = "-nostdin -loglevel error -re -f lavfi -i testsrc2=size=96x64:rate=25 -c:v mpeg4 -g 5 -f rtp_mpegts";
    let mut camera = Command::new("ffmpeg");
    let mut camera = camera.args(words.split(' ')).arg(&url).spawn().unwrap();
    let mut stamps = Vec::new();
    for _ in 0..30 {
        source.next_frame().unwrap().unwrap();
        stamps.push(source.stamp_us().unwrap());
    }
    camera.kill().unwrap();
    camera.wait().unwrap();
    for pair in stamps.windows(2) {
        // A picture that was not taken in time is dropped together with its time.
        let periods = (pair[1] - pair[0] + 20_000) / 40_000;
        let off_us = pair[1] - pair[0] - periods * 40_000;
        assert!(periods >= 1 && off_us.abs() <= ROUNDING_US, "{stamps:?}");
    }
}

#[test]
fn a_live_source_of_another_size_is_refused() {
    let Some(_studio) = studio() else { return };
    let mut source = open_live(
        "lavfi:testsrc2=size=64x96",
        &BTreeMap::new(),
        true,
        expected(),
        Tick(0),
    )
    .unwrap();
    assert!(matches!(
        source.next_frame(),
        Err(SourceError::PixelSize { .. })
    ));
}

#[test]
fn a_stream_that_is_silent_without_closing_is_given_up() {
    // Symptom to prevent: the edge waited for a hanging camera until it ended.
    let Some(studio) = studio() else { return };
    let clip = studio.record(
        "-f lavfi -i testsrc2=size=96x64:rate=30 -frames:v 60 -pix_fmt yuv420p",
        "hang.y4m",
    );
    let bytes = std::fs::read(clip).unwrap();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("tcp://{}", listener.local_addr().unwrap());
    let (closed, wait) = std::sync::mpsc::channel::<()>();
    let camera = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        std::io::Write::write_all(&mut stream, &bytes).unwrap();
        // Open, and without another byte.
        wait.recv().unwrap_err();
    });
    let mut source = open_live(&url, &BTreeMap::new(), true, expected(), Tick(0)).unwrap();
    let problem = std::iter::from_fn(|| Some(source.next_frame())).find_map(Result::err);
    let problem = problem.unwrap();
    assert!(
        matches!(
            problem,
            SourceError::Silent {
                silent_s: 2,
                read: 1..,
                ..
            }
        ),
        "{problem}"
    );
    assert_eq!(source.next_frame(), Ok(None));
    drop((source, closed));
    camera.join().unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn dropping_a_source_leaves_no_process_behind() {
    let Some(_studio) = studio() else { return };
    let mut source = open_live(
        "lavfi:testsrc2=size=96x64",
        &BTreeMap::new(),
        true,
        expected(),
        Tick(0),
    )
    .unwrap();
    assert!(source.next_frame().unwrap().is_some());
    let id = source.ffmpeg.id();
    let process = PathBuf::from(format!("/proc/{id}"));
    assert!(process.exists());
    drop(source);
    // A zombie would still be listed.
    assert!(!process.exists());
}

#[path = "rtsp_tests.rs"]
mod rtsp;
