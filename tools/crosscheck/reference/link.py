"""A session on the link with the daemon: what it was asked over HTTP, what it answered, and what its frames said.

`session` collects; nothing is judged here.
"""

import time
from dataclasses import dataclass, field

from . import frames
from .board import Board

TOUCH_MS = 500
TRIES = 8
REST_S = 0.3
"""Between two tries: a touch is not driven while the panel moves with all the travel there is."""
EFFECTS = {
    "click": {},
    "double_click": {"period_ms": 150},
    "buzz": {"duration_ms": 120},
    "swell": {"duration_ms": 150},
    "pulse_train": {"count": 3, "period_ms": 40},
    "texture": {"duration_ms": 100, "period_ms": 50},
}


def _bad_answers():
    """Name -> function of sequence number and the right answer that gives what the board sends in its place. After each of
    them the host has to ask again."""

    def flipped(_, answer):
        # One bit within a block; not the zero, and no byte becomes one.
        place = len(answer) // 2
        changed = answer[place] ^ (0x04 if answer[place] != 0x04 else 0x08)
        return answer[:place] + bytes([changed]) + answer[place + 1 :]

    return {
        "nothing": lambda sequence, answer: b"",
        "a changed bit": flipped,
        "half a frame": lambda sequence, answer: answer[: len(answer) // 2] + b"\0",
        "a code byte beyond the end": lambda sequence, answer: b"\xf0\x01\x02\x00",
        "only zeros": lambda sequence, answer: b"\0" * 64,
        "noise without a zero": lambda sequence, answer: bytes(1 + (31 * k) % 255 for k in range(3000)) + b"\0",
        "a reply to something else": lambda sequence, answer: frames.Frame(
            2, frames.REPLY, (sequence + 7) % 65536, frames.written("u8", 4)
        ).encoded(),
        "a request": lambda sequence, answer: frames.Frame(2, frames.REQUEST, sequence, b"\x04").encoded(),
    }


# Bodies that no reply has: the frame is whole, so what is wrong is the board's program. The daemon may refuse the touch, but
# must go on.
_FOREIGN = {
    "an unknown reply": lambda sequence, answer: frames.Frame(2, frames.REPLY, sequence, b"\x7f").encoded(),
    "an empty body": lambda sequence, answer: frames.Frame(2, frames.REPLY, sequence, b"").encoded(),
    "a body that is cut": lambda sequence, answer: frames.Frame(2, frames.REPLY, sequence, b"\x03\x04\x00").encoded(),
    "an answer to another request": lambda sequence, answer: frames.Frame(2, frames.REPLY, sequence, b"\x02").encoded(),
}


@dataclass
class Session:
    """What happened. Contents of requests are as `messages.REQUEST` has them."""

    touch: dict = None
    """The answer to a touch, and `drives`: what SetDrives carried."""
    drives: list = None
    told: list = None
    """What the board answered that it does."""
    keep_alives: int = 0
    """Signs of life while it drove."""
    ended: bool = False
    """Whether the touch was ended by a frame."""
    effects: dict = field(default_factory=dict)
    """Name -> (answer, drives of Prepare, contents of PlayOnce, contents of PlayWindows)."""
    stopped: bool = False
    """Whether a stop came on the link at once, and no drive after it."""
    bad_answers: dict = field(default_factory=dict)
    """Name -> whether the drives were set again, and the touch was driven all the same."""
    foreign: dict = field(default_factory=dict)
    """Name -> whether the daemon drove the next touch."""
    broken: list = field(default_factory=list)
    """Frames that could not be read."""


def session(serve, x_px, y_px, effects=("click", "buzz"), malformed=True, intensity_g=0.3, tamper=None, stubborn=False, deaf=()):
    """Starts the daemon on a board of this program's own, and goes through touch, effects, stop and bad answers. `serve` takes
    the command line's arguments and is a context manager of a function (method, path, content) -> (status, answer). `tamper`
    changes what arrives, see `Board`; `stubborn` and `deaf` likewise."""
    seen = Session()
    with Board(tamper=tamper, deaf=deaf) as board, serve("--device", board.path) as request:
        at = {"x_px": x_px, "y_px": y_px, "intensity_g": intensity_g}

        def driven(**more):
            since = board.now()
            status, answer = request("POST", "/v1/touch", {**at, **more})
            return since, status, answer

        since, status, seen.touch = driven(duration_ms=TOUCH_MS)
        if status != 200:
            raise RuntimeError(f"touch: {status} {seen.touch}")
        seen.drives = board.named("SetDrives", since=since)[0][2]["drives"]
        seen.told = list(board.achieved)
        end = _wait(board, lambda content: not content["drives"], since, TOUCH_MS / 1e3 + 3)
        seen.ended = end is not None
        until = end if end is not None else board.now()
        seen.keep_alives = sum(at_s <= until for at_s, *_ in board.named("KeepAlive", "Status", "Details", since=since))

        for effect in effects:
            since, status, answer = driven(effect=effect, **EFFECTS[effect])
            if status != 200:
                raise RuntimeError(f"{effect}: {status} {answer}")
            # A click may be single windows: then no drives are prepared for it.
            prepared = [content["drives"] for *_, content in board.named("Prepare", since=since)]
            played = [content for *_, content in board.named("PlayOnce", since=since)]
            windows = [content for *_, content in board.named("PlayWindows", since=since)]
            seen.effects[effect] = (answer, prepared[0] if prepared else [], played, windows)

        since, status, _ = driven(duration_ms=10_000)
        before = board.now()
        request("POST", "/v1/stop")
        stop = board.wait_for(("Stop", "Disarm"), before)
        after = [drive for drive in board.named("SetDrives", "Prepare", since=before) if drive[2]["drives"]]
        seen.stopped = stop is not None and not after and board.state == "safe"

        if malformed:
            for name, spoil in _bad_answers().items():
                # Again where nothing was driven, as the panel still moves with all its travel, or where a busy computer delivered the
                # good answer after its time, so that the host asked a third time.
                for _ in range(1 if stubborn else TRIES):
                    board.spoil["SetDrives"] = spoil
                    board.stubborn = stubborn
                    since, status, _ = driven(duration_ms=50)
                    asked = sum(bool(content["drives"]) for *_, content in board.named("SetDrives", since=since))
                    seen.bad_answers[name] = status == 200 and asked == 2
                    # The frame that ends this touch is not to get the next bad answer.
                    if asked:
                        _wait(board, lambda content: not content["drives"], since, 2)
                    board.inject(bytes([1 + 13 * k % 255 for k in range(50)]) + b"\0\0")
                    if seen.bad_answers[name]:
                        break
                    time.sleep(REST_S)
            for name, spoil in _FOREIGN.items():
                board.spoil["SetDrives"] = spoil
                driven(duration_ms=50)
                _, status, _ = _again(driven)
                seen.foreign[name] = status == 200
        seen.broken = list(board.broken)
    return seen


def _again(driven, tries=20):
    """A touch once the daemon has found the board again; it looks twice a second."""
    for _ in range(tries):
        since, status, answer = driven(duration_ms=50)
        if status == 200:
            break
        time.sleep(0.1)
    return since, status, answer


def _wait(board, wanted, since, seconds):
    """When a SetDrives with such a content came, or None."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for at_s, _, content in board.named("SetDrives", since=since):
            if wanted(content):
                return at_s
        time.sleep(0.005)
    return None
