//! Tests of streams over sockets: behaviour towards clients, and isolation of clients that hang.

use std::error::Error;
use std::time::Duration;

use farfield_proto::tick::Tick;
use farfield_streams::{StreamReport, StreamSpec, Streams, synthetic};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream, UdpSocket};
use tokio::time::timeout;

type Outcome = Result<(), Box<dyn Error>>;

const SOON: Duration = Duration::from_secs(5);

async fn started(spec: &str) -> Result<Streams, Box<dyn Error>> {
    Ok(Streams::start(&[spec.parse()?], synthetic::facts()).await?)
}

fn report(streams: &Streams) -> StreamReport {
    streams.report().remove(0)
}

fn command(text: &str) -> Vec<u8> {
    let mut packet = (text.len() as u32 + 9).to_le_bytes().to_vec();
    packet.extend_from_slice(&1u32.to_le_bytes());
    packet.extend_from_slice(text.as_bytes());
    packet.push(0);
    packet
}

/// Kind and content of the next packet of QTM's protocol.
async fn packet(client: &mut TcpStream) -> Result<(u32, Vec<u8>), Box<dyn Error>> {
    let size = timeout(SOON, client.read_u32_le()).await??;
    let kind = timeout(SOON, client.read_u32_le()).await??;
    let mut content = vec![0; size as usize - 8];
    timeout(SOON, client.read_exact(&mut content)).await??;
    Ok((kind, content))
}

#[tokio::test]
async fn a_port_in_use_is_refused_with_the_stream() -> Outcome {
    let first = started("qtm=127.0.0.1:0").await?;
    let taken = format!("qtm={}", report(&first).address);
    let refused = started(&taken).await.unwrap_err().to_string();
    assert!(
        refused.starts_with(&format!("stream `{taken}`: cannot listen there: ")),
        "{refused}"
    );
    let twice: Vec<StreamSpec> = vec!["vmc".parse()?, "vmc".parse()?];
    let refused = Streams::start(&twice, synthetic::facts())
        .await
        .unwrap_err();
    assert_eq!(
        refused.to_string(),
        "stream `vmc=127.0.0.1:39539`: found twice, expected once"
    );
    Ok(())
}

#[tokio::test]
async fn poses_become_data_packets_and_the_end_is_announced() -> Outcome {
    let streams = started("qtm=127.0.0.1:0").await?;
    let mut client = TcpStream::connect(report(&streams).address).await?;
    assert_eq!(
        packet(&mut client).await?,
        (1, b"QTM RT Interface connected\0".to_vec())
    );
    client
        .write_all(&command("StreamFrames AllFrames 3D"))
        .await?;
    // No people yet.
    assert_eq!(packet(&mut client).await?.0, 4);
    streams.poses(synthetic::poses_at(3, 17));
    // People arrived.
    assert_eq!(packet(&mut client).await?, (6, vec![1]));
    let (kind, content) = packet(&mut client).await?;
    assert_eq!((kind, &content[8..12]), (3, &17u32.to_le_bytes()[..]));
    assert_eq!(content.len(), 16 + 8 + 8 + 3 * 29 * 12);
    assert_eq!((report(&streams).clients, report(&streams).sent), (1, 1));
    streams.stop().await;
    assert_eq!(packet(&mut client).await?, (6, vec![12]));
    assert_eq!(client.read(&mut [0; 8]).await?, 0);
    Ok(())
}

#[tokio::test]
async fn invalid_packets_end_only_their_connection() -> Outcome {
    let streams = started("qtm=127.0.0.1:0").await?;
    let mut client = TcpStream::connect(report(&streams).address).await?;
    packet(&mut client).await?;
    client
        .write_all(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        .await?;
    assert_eq!(packet(&mut client).await?, (0, b"Parse error\0".to_vec()));
    // With unread bytes, the system may reset the connection instead of closing it.
    assert!(matches!(client.read(&mut [0; 8]).await, Ok(0) | Err(_)));
    assert!(TcpStream::connect(report(&streams).address).await.is_ok());
    Ok(())
}

#[tokio::test]
async fn a_hanging_client_does_not_delay_others() -> Outcome {
    // 5 MB for the client that reads nothing: more than the system buffers.
    const TICKS: u32 = 300;
    let streams = started("qtm=127.0.0.1:0").await?;
    let address = report(&streams).address;
    let socket = TcpSocket::new_v4()?;
    socket.set_recv_buffer_size(4096)?;
    let mut hangs = socket.connect(address).await?;
    hangs
        .write_all(&command("StreamFrames AllFrames 3D 6D Skeleton"))
        .await?;
    let mut reads = TcpStream::connect(address).await?;
    packet(&mut reads).await?;
    reads
        .write_all(&command("StreamFrames AllFrames 3D"))
        .await?;
    packet(&mut reads).await?;
    for tick in 0..TICKS {
        streams.poses(synthetic::poses_at(16, i64::from(tick)));
        let received = loop {
            let (kind, content) = packet(&mut reads).await?;
            if kind == 3 {
                break u32::from_le_bytes(content[8..12].try_into()?);
            }
        };
        assert_eq!(received, tick);
    }
    let counted = report(&streams);
    assert_eq!(counted.clients, 2);
    // The system's buffers took the first frames; then the hanging client blocked within one.
    assert!(counted.sent < u64::from(2 * TICKS), "{counted:?}");
    streams.stop().await;
    Ok(())
}

#[tokio::test]
async fn foxglove_clients_get_channels_and_others_are_refused() -> Outcome {
    let streams = started("foxglove=127.0.0.1:0").await?;
    let address = report(&streams).address;
    let connect = async |head: &str| -> Result<(TcpStream, String), Box<dyn Error>> {
        let mut client = TcpStream::connect(address).await?;
        let request = format!(
            "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{head}\r\n"
        );
        client.write_all(request.as_bytes()).await?;
        let mut response = vec![0; 400];
        let n = timeout(SOON, client.read(&mut response)).await??;
        response.truncate(n);
        Ok((client, String::from_utf8_lossy(&response).into_owned()))
    };
    let (_, response) = connect("").await?;
    assert!(response.starts_with("HTTP/1.1 400"), "{response}");
    let stranger = "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\nOrigin: http://example.org\r\n";
    let (_, response) = connect(stranger).await?;
    assert!(response.starts_with("HTTP/1.1 403"), "{response}");
    let own = "Sec-WebSocket-Protocol: other, foxglove.websocket.v1\r\nOrigin: https://app.foxglove.dev\r\n";
    let (mut client, response) = connect(own).await?;
    assert!(response.starts_with("HTTP/1.1 101"), "{response}");
    assert!(
        response.contains("sec-websocket-protocol: foxglove.websocket.v1\r\n"),
        "{response}"
    );
    let mut more = vec![0; 20_000];
    let n = timeout(SOON, client.read(&mut more)).await??;
    let response = response + &String::from_utf8_lossy(&more[..n]);
    assert!(
        response.contains(r#"{"op":"serverInfo","name":"Farfield: synthetic""#),
        "{response}"
    );
    Ok(())
}

#[tokio::test]
async fn people_have_their_own_ports() -> Outcome {
    // Two adjacent free ports.
    let (first, second) = loop {
        let first = UdpSocket::bind("127.0.0.1:0").await?;
        let port = first.local_addr()?.port();
        if port < 60_000
            && let Ok(second) = UdpSocket::bind(("127.0.0.1", port + 1)).await
        {
            break (first, second);
        }
    };
    let streams = started(&format!("vmc={}", first.local_addr()?)).await?;
    let mut poses = synthetic::poses_at(2, 0);
    streams.poses(poses.clone());
    let mut datagram = [0; 2000];
    for socket in [&first, &second] {
        // On this machine a person is one datagram.
        let n = timeout(SOON, socket.recv(&mut datagram)).await??;
        assert!(datagram[..n].starts_with(b"#bundle\0"));
        assert_eq!(n, 1696);
    }
    // The first person leaves; the second keeps its port.
    poses.tick = Tick(1);
    poses.persons.remove(0);
    streams.poses(poses);
    timeout(SOON, second.recv(&mut datagram)).await??;
    assert!(first.try_recv(&mut datagram).is_err());
    Ok(())
}

/// The value of a field in the XML of a stream.
fn field(xml: &str, name: &str) -> Option<String> {
    let (_, rest) = xml.split_once(&format!("<{name}>"))?;
    Some(rest.split_once('<')?.0.to_owned())
}

async fn ask_lsl(address: std::net::SocketAddr, request: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut client = TcpStream::connect(address).await?;
    client.write_all(request.as_bytes()).await?;
    let mut answer = Vec::new();
    timeout(SOON, client.read_to_end(&mut answer)).await??;
    Ok(answer)
}

#[tokio::test]
async fn an_lsl_inlet_gets_the_stream_clock_and_samples() -> Outcome {
    let streams = started("lsl=127.0.0.1:0").await?;
    let address = report(&streams).address;
    let full = String::from_utf8(ask_lsl(address, "LSL:fullinfo\r\n").await?)?;
    assert!(full.contains("<label>p8_head_z</label>"), "{full}");
    let uid = field(&full, "uid").ok_or("no uid")?;
    let service: u16 = field(&full, "v4service_port").ok_or("no port")?.parse()?;

    let inlet = UdpSocket::bind("127.0.0.1:0").await?;
    let mut bytes = [0; 4096];
    let own = inlet.local_addr()?.port();
    for (query, is_meant) in [("type='EEG'", false), ("type='MoCap'", true)] {
        let query = format!("LSL:shortinfo\r\n{query}\r\n{own} {is_meant}\r\n");
        inlet
            .send_to(query.as_bytes(), ("127.0.0.1", service))
            .await?;
    }
    let n = timeout(SOON, inlet.recv(&mut bytes)).await??;
    let found = String::from_utf8(bytes[..n].to_vec())?;
    assert!(found.starts_with("true\r\n<?xml"), "{found}");
    assert_eq!(field(&found, "uid"), Some(uid.clone()));
    inlet
        .send_to(b"LSL:timedata\r\n7 1.5\r\n", ("127.0.0.1", service))
        .await?;
    let n = timeout(SOON, inlet.recv(&mut bytes)).await??;
    let times = String::from_utf8(bytes[..n].to_vec())?;
    let times: Vec<f64> = times
        .split_whitespace()
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    assert!(
        matches!(times[..], [7.0, 1.5, came, left] if 0.0 < came && came <= left),
        "{times:?}"
    );

    let other = ask_lsl(address, "LSL:streamfeed/110 another\r\n\r\n").await?;
    assert_eq!(other, b"LSL/110 404 Not found\r\n\r\n");
    assert!(ask_lsl(address, "GET / HTTP/1.1\r\n\r\n").await?.is_empty());

    let mut client = TcpStream::connect(address).await?;
    let request =
        format!("LSL:streamfeed/110 {uid}\r\nValue-Size: 4\r\nData-Protocol-Version: 110\r\n\r\n");
    client.write_all(request.as_bytes()).await?;
    let sample = 9 + 4 * farfield_streams::lsl::sample::N_CHANNELS;
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        head.push(timeout(SOON, client.read_u8()).await??);
    }
    let mut known = vec![0; 2 * sample];
    timeout(SOON, client.read_exact(&mut known)).await??;
    streams.poses(synthetic::poses_at(2, 30));
    let mut first = vec![0; sample];
    timeout(SOON, client.read_exact(&mut first)).await??;
    assert_eq!(first[9..13], 30.0_f32.to_le_bytes());
    assert_eq!(first[13..17], 1.0_f32.to_le_bytes());
    streams.stop().await;
    Ok(())
}
