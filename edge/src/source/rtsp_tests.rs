//! A camera that speaks RTSP (RFC 2326) over one TCP connection. It streams H.264 (RFC 6184), and
//! its sender reports give the capture times.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use farfield_node::clock;

use super::*;

/// Capture time of the first picture, Unix time in seconds, and in RTP units.
const BEGAN_S: i64 = 1_600_000_000;
const BEGAN_UNITS: u32 = 123_456;
/// RTP units between pictures at 30 Hz.
const PERIOD_UNITS: u32 = 3000;
/// Pictures of the repeated clip: picture n has the brightness 16 + 3 n.
const PICTURES: i64 = 60;
/// RTP payload type of the stream.
const PAYLOAD: u8 = 96;
/// Pictures per sender report. Before the first report the capture times are unknown.
const REPORT_EVERY: u32 = 45;
/// From 1900, the start of NTP's time, to 1970, seconds.
const NTP_TO_UNIX_S: i64 = 2_208_988_800;

/// The H.264 units of a stream made by [`Studio::record`], by picture.
fn pictures(stream: &[u8]) -> Vec<Vec<Vec<u8>>> {
    let starts: Vec<usize> = (0..stream.len() - 3)
        .filter(|&at| stream[at..at + 3] == [0, 0, 1])
        .collect();
    let ends = starts.iter().skip(1).copied().chain([stream.len()]);
    let mut pictures = vec![Vec::new()];
    for (start, end) in starts.iter().zip(ends) {
        // Zeros before a start code belong to it.
        let unit = &stream[start + 3..end];
        let length = unit.iter().rposition(|&byte| byte != 0).unwrap() + 1;
        pictures.last_mut().unwrap().push(unit[..length].to_vec());
        // Each picture is one slice, of type 1, or 5 at a key frame.
        if matches!(unit[0] & 31, 1 | 5) {
            pictures.push(Vec::new());
        }
    }
    pictures.pop();
    pictures
}

/// Answers the client until it sends PLAY.
fn answer_until_play(stream: &TcpStream) -> std::io::Result<()> {
    let (mut lines, mut to) = (BufReader::new(stream).lines(), stream);
    loop {
        let request: Vec<String> = lines
            .by_ref()
            .map_while(Result::ok)
            .take_while(|line| !line.is_empty())
            .collect();
        let Some(method) = request.first().and_then(|line| line.split(' ').next()) else {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        };
        let number = request
            .iter()
            .find(|line| line.starts_with("CSeq"))
            .unwrap();
        let sdp = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1\r\na=control:video\r\n";
        let rest = match method {
            "DESCRIBE" => format!(
                "Content-Type: application/sdp\r\nContent-Length: {}\r\n\r\n{sdp}",
                sdp.len()
            ),
            "SETUP" => {
                "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 7\r\n\r\n".to_owned()
            }
            _ => "Session: 7\r\n\r\n".to_owned(),
        };
        write!(to, "RTSP/1.0 200 OK\r\n{number}\r\n{rest}")?;
        if method == "PLAY" {
            return Ok(());
        }
    }
}

/// Streams until the client disconnects.
fn stream(mut to: &TcpStream, pictures: &[Vec<Vec<u8>>]) -> std::io::Result<()> {
    let mut send = |channel: u8, packet: &[u8]| {
        let length = (packet.len() as u16).to_be_bytes();
        to.write_all(&[&[b'$', channel], &length[..], packet].concat())
    };
    let (begun, source) = (clock::now(), 5_u32.to_be_bytes());
    let mut packets = 0_u16;
    for (number, units) in (0_u32..).zip(pictures.iter().cycle()) {
        let due = begun + Duration::from_secs(number.into()) / 30;
        std::thread::sleep(due.saturating_duration_since(clock::now()));
        let at_units = (BEGAN_UNITS + number * PERIOD_UNITS).to_be_bytes();
        if number % REPORT_EVERY == REPORT_EVERY - 1 {
            let seconds = (BEGAN_S + NTP_TO_UNIX_S + i64::from(number / 30)) as u32;
            let fraction = (u64::from(number % 30) << 32) / 30;
            let head = [0x80, 200, 0, 6];
            let ntp = [seconds.to_be_bytes(), (fraction as u32).to_be_bytes()].concat();
            send(1, &[&head, &source, &ntp[..], &at_units, &[0; 8]].concat())?;
        }
        for (index, unit) in units.iter().enumerate() {
            let is_last = u8::from(index + 1 == units.len());
            let head = [0x80, PAYLOAD + (is_last << 7)];
            send(
                0,
                &[&head, &packets.to_be_bytes()[..], &at_units, &source, unit].concat(),
            )?;
            packets = packets.wrapping_add(1);
        }
    }
    Ok(())
}

#[test]
fn sender_reports_give_the_capture_times() {
    let Some(studio) = studio() else { return };
    let clip = studio.record(
        "-f lavfi -i nullsrc=size=96x64:rate=30,geq=lum=16+3*N:cb=128:cr=128 -frames:v 60 -pix_fmt yuv420p \
         -c:v libx264 -qp 4 -tune zerolatency -x264-params slices=1:sliced-threads=0:keyint=60:repeat-headers=1",
        "camera.h264",
    );
    let pictures = pictures(&std::fs::read(clip).unwrap());
    assert_eq!(i64::try_from(pictures.len()), Ok(PICTURES));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("rtsp://{}/1", listener.local_addr().unwrap());
    let camera = std::thread::spawn(move || {
        let (to, _) = listener.accept().unwrap();
        // It ends when the client disconnects.
        answer_until_play(&to)
            .and_then(|()| stream(&to, &pictures))
            .ok();
    });
    let mut source = open_live(&url, &BTreeMap::new(), true, expected(), Tick(0)).unwrap();
    let mut unknown = 0;
    let mut known = Vec::new();
    while known.len() < 20 {
        let FrameContent::Image(picture) = source.next_frame().unwrap().unwrap().content else {
            panic!("an image was asked for");
        };
        match source.captured_unix_us() {
            None => unknown += 1,
            Some(unix_us) => known.push((picture, unix_us - BEGAN_S * 1_000_000)),
        }
        assert!(unknown < 200, "the reports are not heard");
    }
    drop(source);
    camera.join().unwrap();
    assert!(unknown > 30, "before the first report it is unknown");
    for (picture, after_us) in known {
        let brightness = f64::from(picture.to_grey().get_pixel(48, 32).0[0]);
        let shown = ((brightness * 219.0 / 255.0) / 3.0).round() as i64;
        let number = (after_us as f64 * 30.0 / 1e6).round() as i64;
        let off_us = after_us - number * 1_000_000 / 30;
        assert_eq!(number % PICTURES, shown, "{after_us}");
        assert!(off_us.abs() <= 1_100, "{after_us}");
    }
}
