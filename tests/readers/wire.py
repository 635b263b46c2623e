"""The messages of the wire, versions 1 and 2, as in docs/protocol.md: bytes to plain Python values, and back.

Of the bounds on the page this checks counts, lengths and that numbers are finite, but nothing between fields.
"""

from postcard import BOOL, BYTES, F32, F64, I32, I64, TEXT, U8, U16, U32, U64, Array, Bytes, Enum, List, Option, Raw, Struct

VERSIONS = range(1, 3)
MOST_BYTES = 1 << 20
PERSONS, CAMERAS, VIEWPOINTS, KEYPOINTS, JOINTS = 256, 64, 256, 64, 64  # At most.
NAME, SHORT, REASON_TEXT, LONG = (Bytes("text", most) for most in (64, 256, 512, 8192))
PIECE = Bytes("bytes", 65_536)

PAIR, I32_PAIR, POINT = Array(F32, 2), Array(I32, 2), Array(F32, 3)

# Patches, from edge to fusion.
ECHO = Struct("BoxEcho", sequence=U32, held_us=U32)
TIMING = Struct("PatchTiming", sent_after_us=I32, clock_correction_us=I32, echo=Option(ECHO))
GRID = Struct("CellGrid", origin_px=PAIR, step_px=PAIR, width=U16, height=U16)
SHORT_GRID = Struct("short grid", origin_quarters=I32_PAIR, step_256ths=I32_PAIR)
CROPS = Enum(
    "crops",
    one=Struct("one", grid=SHORT_GRID),
    two=Struct("two", first=SHORT_GRID, second=SHORT_GRID, on_second=U64),
    other=Struct("other", grids=List(GRID, 4), crop_of_keypoint=Bytes("bytes", KEYPOINTS)),
)
SIZE = Enum("size", "48x64x17", "72x96x17", "40x56x17", other=Struct("other", width=U16, height=U16, keypoints=U8))
PATCH = Struct("PersonPatch", person=U32, camera=U16, box_age=I64, capture_offset_us=I32, crops=CROPS, size=SIZE, maps=BYTES)
PATCH_SET = Struct(
    "PatchSet", session=U64, tick=I64, viewpoint=U16, part=U16, parts=U16, sighting_parts=U16, timing=Option(TIMING), persons=List(PATCH, PERSONS)
)

# Boxes, from fusion to edge.
WHOLE = Struct(
    "whole", camera=U16, center_4ths=I32_PAIR, size_4ths=I32_PAIR, torso_4ths=I32_PAIR, neck_4ths=I32_PAIR, rotation_512ths=I32,
    center_rate_16ths=I32_PAIR, size_rate_16ths=I32_PAIR, rotation_rate_4096ths=I32,
)
BOX = Struct("BoundingBox", center_px=PAIR, size_px=PAIR, rotation_rad=F32)
FULL = Struct("other", camera=U16, bounding_box=BOX, rate=BOX, torso_px=PAIR, neck_px=PAIR)
PERSON_BOXES = Struct("PersonBoxes", person=U32, cameras=List(Enum("box", whole=WHOLE, other=FULL), CAMERAS))
HEARD = Struct("HeardPatches", tick=I64, one_way_us=I32, bytes=U32)
LIVE_BOXES = Struct("LiveBoxes", sequence=U32, epoch_us=U64, clock_correction_us=Option(I32), heard=Option(HEARD))
BOX_SET_REST = {
    "order": Enum("order", "track", "end"), "live": Option(LIVE_BOXES), "detection_cameras": List(U16, CAMERAS),
    "persons": List(PERSON_BOXES, PERSONS),
}
BOX_SET_HEAD = {"session": U64, "tick": I64, "viewpoint": U16, "part": U16, "parts": U16}
BOX_SET = Struct("BoxSet", **BOX_SET_HEAD, **BOX_SET_REST, every_nth_tick=U16)
BOX_SET_1 = Struct("BoxSet", **BOX_SET_HEAD, **BOX_SET_REST)

# Sightings, from edge to fusion; poses, events, decisions, from fusion to all.
PEAK = Struct("KeypointPeak", position_px=PAIR, score=F32)
SIGHTING = Struct("Sighting", camera=U16, score=F32, keypoints=List(Option(PEAK), KEYPOINTS))
WHOLE_PEAK = Struct("peak", position_16ths=I32_PAIR, score_255ths=U8)
WHOLE_SIGHTING = Struct("whole", camera=U16, score_255ths=U8, count=U8, seen=U64, peaks=List(WHOLE_PEAK, KEYPOINTS))
SIGHTING_SET_HEAD = {"session": U64, "tick": I64, "viewpoint": U16, "part": U16, "parts": U16}
SIGHTING_SET = Struct("SightingSet", **SIGHTING_SET_HEAD, sightings=List(Enum("sighting", whole=WHOLE_SIGHTING, other=SIGHTING), 256))
POSE = Struct(
    "PersonPose", person=U32, state=Enum("state", "tentative", "tracked", "coasting"), joints_m=List(POINT, JOINTS),
    keypoints_m=List(POINT, KEYPOINTS), sigma_m=List(F32, JOINTS), angles=List(F32, JOINTS), unobserved=U64, views=U16,
)
POSE_SET = Struct("PoseSet", session=U64, tick=I64, persons=List(POSE, PERSONS))
LIKENESS = Struct("Likeness", distance_m=F32, absence_s=F32, lengths_sigma=F32, log_ratio=F32, margin=Option(F32))
REASON = Enum(
    "reason",
    contradicted=Struct("", seen=U32, missed=U32),
    poster=Struct("", flat_m=F32, moved_m=F32),
    not_seen_again=Struct("", missing_s=F32),
    unseen=Struct("", unseen_s=F32),
    one_view=Struct("", missing_s=F32),
    outside_field=Struct("", at_m=POINT),
    same_place=Struct("", other=U32, for_s=F32),
    found_elsewhere=None,
    given_by_hand=None,
)
CHANGE = Enum(
    "change",
    initiate=Struct("", views=U16),
    give=None,
    reinitiate=Struct("", moved_m=F32),
    confirm=Struct("", seen_s=F32),
    recognise=Struct("", old=U32, why=LIKENESS),
    lose=Struct("", missing_s=F32),
    find=Struct("", lost_s=F32),
    revive=Struct("", why=LIKENESS),
    step_back=Struct("", other=U32, distance_m=F32, since_s=F32),
    drop=Struct("", reason=REASON),
)
EVENT = Struct("IdentityEvent", person=U32, wire_id=U32, change=CHANGE)
EVENT_SET = Struct("IdentityEventSet", session=U64, tick=I64, events=List(EVENT, 4096))
# Recognised subjects of the venue.
BODY_LIKENESS = Struct("BodyLikeness", lengths_sigma=F32, log_ratio=F32, margin=Option(F32))
FINDING = Enum(
    "finding",
    named=Struct("", subject=SHORT, why=BODY_LIKENESS),
    nobody_alike=Struct("", nearest=SHORT, why=BODY_LIKENESS),
    ambiguous=Struct("", nearest=SHORT, why=BODY_LIKENESS),
)
NAMING_SET = Struct("NamingSet", session=U64, tick=I64, namings=List(Struct("Naming", person=U32, finding=FINDING), 512))

USED = Struct("UsedSet", viewpoint=U16, part=U16)
DECISION = Struct("Decision", session=U64, first=I64, tick=I64, horizons_ticks=List(F64, VIEWPOINTS), patches=List(USED), sightings=List(USED))

# Thumbnails, from edge to fusion, for people.
THUMBNAIL = Struct("Thumbnail", session=U64, tick=I64, viewpoint=U16, camera=U16, jpeg=Bytes("bytes", 24_576))

# Statuses, from every node to all.
STAGE = Struct("StageTime", stage=LONG, count=U64, total_us=U64, p50_us=U32, p99_us=U32, p999_us=U32, max_us=U32)
CAMERA = {"camera": U16, "health": Enum("health", "works", "frozen", "black", "silent", "failed"), "frames_per_s": F32, "capture_offset_us": I32, "reason": Option(REASON_TEXT)}
EDGE_LINK = Struct(
    "EdgeLink", viewpoint=NAME, live=BOOL, refused=Option(LONG), round_trip_us=Option(U32), clock_offset_us=Option(I32), horizon_ticks=F32,
    bytes_per_s=U32, late=U64, missing=U64, unreadable=U64,
)


LIVE_STATUS = Struct(
    "LiveStatus", epoch_us=Option(U64), clock_correction_us=I32, quality=U8, persons_per_tick=Option(U16), every_nth_tick=U16,
    bytes_per_s=U32, held_back=U64, missed_ticks=U64, cameras=List(Struct("CameraStatus", **CAMERA), CAMERAS),
    edges=List(EDGE_LINK, VIEWPOINTS), recording_failure=Option(LONG),
)
SYSTEM_CLOCK = Struct("SystemClock", synchronised=BOOL, max_error_us=Option(U32), ahead_us=I64)
LINK_HEALTH = Struct("LinkHealth", clock_uncertainty_us=Option(U32), clock_correction_us=Option(I32), dropped=U64)
HEALTH = Struct(
    "NodeHealth", system_clock=Option(SYSTEM_CLOCK), certificate_ends_s=Option(U64), follows=Option(U64),
    links=List(LINK_HEALTH, VIEWPOINTS), notices=List(REASON_TEXT, 16),
)
AGREEMENT = Struct(
    "CameraAgreement", verdict=Enum("verdict", "unknown", "agrees", "disagrees"), keypoints=U64, distance_mm=Option(F32),
    distance_px=Option(F32), late_ticks=Option(F32),
)
AGREEMENTS = List(Struct("AgreementOfCamera", camera=U16, agreement=AGREEMENT), 16_384)
STATUS_FIELDS = dict(
    node=NAME, process=U64, viewpoint=Option(U16), release=SHORT, ready=BOOL, venue_hash=SHORT, calibration_hash=SHORT,
    network_hash=SHORT, backend=LONG, ticks=Option(Array(I64, 2)), tick=Option(I64), unreadable=U64, failure=Option(LONG),
    stages=List(STAGE, 32), live=Option(LIVE_STATUS), health=HEALTH, agreement=AGREEMENTS,
)
STATUS_1 = Struct("Status", **STATUS_FIELDS)
STATUS = Struct("Status", **STATUS_FIELDS, needed_nth_tick=U16)

# Requests and answers.
FILL_REQUEST = Struct("FillRequest", session=U64, **{"from": I64}, to=I64, max_bytes=U32)
FILLED = Struct("Filled", to=I64, stored=List(Struct("StoredSet", kind=Enum("kind", "patches", "sightings"), bytes=Bytes("bytes", MOST_BYTES)), 4096))
REQUEST = Enum("HandoutRequest", "list", chunk=Struct("", file=U16, **{"from": U64}))
FILE = Struct(
    "SharedFile", kind=Enum("kind", "venue", "calibration", "network_card", "network", "detector_card", "detector"), path=Bytes("text", 1024), bytes=U64,
    blake3=Raw(32),
)
FILE_LIST = Struct("FileList", venue=TEXT, files=List(FILE, 16))
SIGNED_LIST = Struct("SignedList", list=PIECE, signature=Option(Struct("ListSignature", certificate=PIECE, ecdsa=PIECE)))
CHUNK = Struct("Chunk", bytes=PIECE)

# By the names of the files in proto/golden; where a version wrote another type, which one.
MESSAGES = {
    "patch_set": PATCH_SET, "box_set": BOX_SET, "sighting_set": SIGHTING_SET, "sighting_set_whole": SIGHTING_SET, "pose_set": POSE_SET, "identity_events": EVENT_SET,
    "decision": DECISION, "status": STATUS, "fill_request": FILL_REQUEST, "filled": FILLED, "handout_request": REQUEST,
    "handout_request_list": REQUEST, "file_list": FILE_LIST, "signed_list": SIGNED_LIST, "chunk": CHUNK, "thumbnail": THUMBNAIL,
    "namings": NAMING_SET,
}
OLDER = {("box_set", 1): BOX_SET_1, ("status", 1): STATUS_1}
# By the second part of a key, under the venue's name.
BY_KEY = {
    "patch": "patch_set", "sighting": "sighting_set", "box": "box_set", "pose": "pose_set", "smooth": "pose_set", "decision": "decision",
    "event": "identity_events", "status": "status", "thumbnail": "thumbnail", "naming": "namings",
}


def decode(name, data, seen=lambda *_: None):
    """The message in `data`, which must be all of it."""
    if not data or len(data) > MOST_BYTES:
        raise ValueError(f"{len(data)} bytes")
    version = data[0]
    if version not in VERSIONS:
        raise ValueError(f"version {version}: this reads {VERSIONS.start} to {VERSIONS.stop - 1}")
    seen(0, 1, "", "version", version)
    try:
        value, at = OLDER.get((name, version), MESSAGES[name]).read(data, 1, "", seen)
    except IndexError:
        raise ValueError("the bytes end before the message") from None
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes are left over")
    return value


def encode(name, value, version):
    """The message as `version` writes it."""
    return bytes([version]) + OLDER.get((name, version), MESSAGES[name]).write(value)
