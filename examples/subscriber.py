"""Prints where everybody is, tick by tick. pip install eclipse-zenoh; python subscriber.py VENUE [ENDPOINT]"""
import json, signal, struct, sys
import zenoh

def number(data):  # What these bytes mean: docs/protocol.md
    byte = next(data)
    return byte if byte < 128 else byte - 128 + 128 * number(data)

def floats(data, width):
    return [struct.unpack(f"<{width}f", bytes(next(data) for _ in range(4 * width))) for _ in range(number(data))]

if len(sys.argv) < 2:
    sys.exit(__doc__)
signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it, also while it waits for fusion.
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": sys.argv[2:] or ["tcp/127.0.0.1:7447"], "connect/timeout_ms": -1}.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config) as session, session.declare_subscriber(f"{sys.argv[1]}/pose") as poses:
    print("tick person state x_m y_m z_m views", flush=True)
    for sample in poses:
        data = iter(sample.payload.to_bytes())
        if (version := next(data)) not in (1, 2):
            sys.exit(f"poses of version {version}: this reads 1 and 2")
        _session, tick = number(data), number(data)
        for _ in range(number(data)):
            person, state = number(data), ("tentative", "tracked", "coasting")[number(data)]
            joints_m, _keypoints_m, _sigma_m, _angles = (floats(data, width) for width in (3, 3, 1, 1))
            _unobserved, views = number(data), number(data)
            print(tick // 2, person, state, *joints_m[0], views, flush=True)
