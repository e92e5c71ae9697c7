"""acut-scan as tests run it, and spools read by spool.md alone (with xxhash and hashlib, none of acut's code)."""
import hashlib
import os
import shutil
import struct
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "e2e"))
from e2e import Fault, expect, unavailable  # noqa: E402

try:
    import xxhash
except ImportError:
    xxhash = None

SCAN = os.environ["ACUT_SCAN"]
PROFILES = os.environ["ACUT_PROFILES"]
SOURCE = os.environ["ACUT_SOURCE"]
DATA, EVENT, CLOCK, SENT, END = 1, 2, 3, 4, 5


class Done:
    def __init__(self, p, out, err):
        self.status, self.out, self.err = p.returncode, out.decode(), err.decode()

    def ok(self, status=0):
        expect(self.status == status, "status %d, wanted %d\n%s%s" % (self.status, status, self.out, self.err))
        return self


def start(*args, stdin=subprocess.DEVNULL, env=None, cwd=None, preexec_fn=None):
    full = {k: v for k, v in os.environ.items() if k != "NOTIFY_SOCKET"}
    full.update(env or {})
    return subprocess.Popen([SCAN, *args], stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=full, cwd=cwd,
                            preexec_fn=preexec_fn)


def finish(p, given=None, timeout=180):
    out, err = p.communicate(given, timeout=timeout)
    return Done(p, out, err)


def run(*args, given=None, **kw):
    return finish(start(*args, stdin=subprocess.PIPE if given is not None else subprocess.DEVNULL, **kw), given)


class Folder:
    def __enter__(self):
        self.path = tempfile.mkdtemp(prefix="acut-scan-")
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.path, ignore_errors=True)

    def __call__(self, name):
        return os.path.join(self.path, name)


class Spool:
    """Head, whole records, whether the bytes behind them are torn; any fault of the format is a Fault."""

    def __init__(self, path):
        if not xxhash:
            unavailable("python3-xxhash is not installed")
        with open(path, "rb") as f:
            b = f.read()
        expect(b[:8] == b"\x89ACUTSP\n", "magic %r" % b[:8])
        version, size, check = struct.unpack_from("<IIQ", b, 8)
        expect(version == 1 and size % 4096 == 0 and b[:size] == b[size:2 * size], "head")
        head = b[:16] + bytes(8) + b[24:size]
        expect(xxhash.xxh3_64_intdigest(head) == check, "check of the head")
        self.id = b[24:40]
        self.vendor, self.product, zero, self.utc, self.mono = struct.unpack_from("<HHIqq", b, 40)
        at = 64
        self.texts = []
        for _ in range(6):
            n, = struct.unpack_from("<H", b, at)
            self.texts.append(b[at + 2:at + 2 + n].decode())
            at += 2 + n
        n, = struct.unpack_from("<I", b, at)
        self.profile = b[at + 4:at + 4 + n].decode()
        self.manufacturer, self.model, self.serial, self.port, self.profile_name, self.boot = self.texts
        expect(not any(b[at + 4 + n:size]) and not zero, "no zeros behind the head")
        seed = xxhash.xxh3_64_intdigest(self.id)
        at = 2 * size
        self.records = []
        while len(b) - at >= 40:
            mark, low, kind, flags, zero, n, seq, time, payload = struct.unpack_from("<IIBBHIQqQ", b, at)
            good = mark == 0x1e434552 and low == xxhash.xxh3_64_intdigest(b[at + 8:at + 40], seed=seed) & 0xffffffff
            if not good or at + 40 + n > len(b) or xxhash.xxh3_64_intdigest(b[at + 40:at + 40 + n], seed=seed) != payload:
                break
            expect(seq == len(self.records) and not zero, "record %d is number %d" % (len(self.records), seq))
            self.records.append((kind, flags, time, b[at + 40:at + 40 + n]))
            at += 40 + n
        self.torn = len(b) - at
        self.data = b"".join(r[3] for r in self.records if r[0] == DATA)
        self.events = [r[3].decode() for r in self.records if r[0] == EVENT]
        self.ended = bool(self.records) and self.records[-1][0] == END
        if self.ended:
            records, transfers, size, events, sha = struct.unpack("<QQQQ32s", self.records[-1][3])
            expect((records, transfers, size, events) == (len(self.records) - 1, sum(r[0] == DATA for r in self.records), len(self.data),
                                                          len(self.events)), "totals")
            expect(sha == hashlib.sha256(self.data).digest(), "SHA-256")


def telegrams(n):
    return b"".join(b"\x02sSN LMDscandata %d\x03" % i for i in range(n))


def main(*cases):
    wanted, failed, skipped = sys.argv[1:], 0, 0
    for case in cases:
        if wanted and case.__name__ not in wanted:
            continue
        try:
            case()
            print("ok", case.__name__, flush=True)
        except (Fault, subprocess.TimeoutExpired) as e:
            failed += 1
            print("FAIL", case.__name__, e, flush=True)
    sys.exit(1 if failed else 0)
