"""A second implementation of acut's protocol, written from docs/formats/protocol.md, docs/formats/stream.md and acut.proto alone, with the
official protobuf library. It is for tests, and checks everything that those pages promise."""
import array
import os
import select
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import time

HEADER = struct.Struct("<HHIIB3s")
MAGIC, VERSION, BODY_MAX = 0x4341, 1, 65536 - 16
U64 = (1 << 64) - 1


class Fault(AssertionError):
    """A failure of a test."""


class Breach(Fault):
    """The other side broke the protocol."""


class Gone(Fault):
    """The other side closed the connection between two frames."""


class Refused(Fault):
    """An Error was the answer."""

    def __init__(self, error):
        super().__init__("%s: %s" % (error.code, error.message))
        self.error, self.code = error, error.code


def load_messages():
    """The module that protoc makes of acut.proto."""
    proto = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "proto")
    with tempfile.TemporaryDirectory(prefix="acut-pb2-") as out:
        subprocess.run(["protoc", "--python_out=" + out, "--proto_path=" + proto, "acut.proto"], check=True)
        sys.path.insert(0, out)
        try:
            import acut_pb2
        finally:
            sys.path.remove(out)
    return acut_pb2


pb = load_messages()


# ---- frames ----

def pack(request_id, message, descriptors=0):
    """A frame as bytes. `message`: a Message, or bytes for a broken one."""
    body = message if isinstance(message, bytes) else message.SerializeToString()
    return HEADER.pack(MAGIC, VERSION, len(body), request_id, descriptors, b"\0\0\0") + body


class Wire:
    """Frames over a socket, waiting."""

    def __init__(self, path, timeout=240.0):
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        # Full is the queue at the door: waits for a place in it, which a socket with one of Python's time-outs does not.
        self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", 1, 0))
        deadline = time.monotonic() + timeout
        while True:
            try:
                self.sock.connect(path)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise
        self.sock.settimeout(timeout)
        self.timeout = timeout

    def fileno(self):
        return self.sock.fileno()

    def close(self):
        self.sock.close()

    def send_raw(self, data, fds=()):
        """All bytes; the descriptors go with the first of them."""
        control = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", fds))] if fds else []
        sent = self.sock.sendmsg([data], control)
        if sent < len(data):
            self.sock.sendall(data[sent:])

    def send(self, request_id, message, fd=-1):
        self.send_raw(pack(request_id, message, fd >= 0), [fd] if fd >= 0 else [])

    def _read(self, n, fds, at_start):
        data = b""
        while len(data) < n:
            part, got, flags, _ = socket.recv_fds(self.sock, n - len(data), 8, socket.MSG_CMSG_CLOEXEC)
            fds.extend(got)
            if flags & socket.MSG_CTRUNC:
                raise Breach("more descriptors than fit")
            if not part:
                if at_start and not data:
                    raise Gone()
                raise Breach("the connection ended inside a frame")
            data += part
        return data

    def recv(self):
        """(request id, Message, descriptor or -1)."""
        fds = []
        try:
            head = self._read(HEADER.size, fds, True)
            magic, version, length, request_id, descriptors, zero = HEADER.unpack(head)
            if magic != MAGIC or version != VERSION or length > BODY_MAX or zero != b"\0\0\0" or descriptors > 1:
                raise Breach("bad header %r" % head)
            message = pb.Message()
            message.ParseFromString(self._read(length, fds, False))
            if len(fds) != descriptors:
                raise Breach("%d descriptors announced, %d came" % (descriptors, len(fds)))
        except BaseException:
            for fd in fds:
                os.close(fd)
            raise
        return request_id, message, fds[0] if fds else -1


# ---- requests ----

class Client:
    """A well-behaved client. `body` names a member of Message.body."""

    def __init__(self, path, greet=True, timeout=240.0):
        self.wire = Wire(path, timeout)
        self.last = 0
        self.durable = {}      # request id of a PushBegin: files 1..n are safe
        self.progress = []
        self.waiting = {}      # answers that came before somebody asked
        self.hello = None
        if greet:
            self.hello = self.ask("hello", pb.Hello(version_min=1, version_max=1, build="python", program="acut_wire"))

    def close(self):
        self.wire.close()

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.close()

    def send(self, body, value, fd=-1):
        self.last += 1
        message = pb.Message()
        getattr(message, body).CopyFrom(value)
        if message.WhichOneof("body") != body:
            getattr(message, body).SetInParent()
        self.wire.send(self.last, message, fd)
        return self.last

    def answer(self, request_id, *want):
        """Waits for the answer to the last request, past messages of progress: (value, descriptor)."""
        while True:
            queue = self.waiting.get(request_id)
            got, message, fd = (request_id,) + queue.pop(0) if queue else self.wire.recv()
            kind = message.WhichOneof("body")
            if kind == "progress":
                self.progress.append(message.progress)
            elif kind == "durable":
                if message.durable.files < self.durable.get(got, 0):
                    raise Breach("Durable went back")
                self.durable[got] = message.durable.files
            elif got == 0 and kind == "error":
                raise Refused(message.error)
            elif got != request_id:
                self.waiting.setdefault(got, []).append((message, fd))
            elif kind == "error":
                raise Refused(message.error)
            elif kind not in want:
                raise Breach("%s came, %s was expected" % (kind, want))
            else:
                return getattr(message, kind), fd

    ANSWERS = {
        "hello": "hello", "ping": "done", "status_request": "status", "push_begin": "push_begun", "probe": "probed",
        "push_plan": "push_planned", "file": "file_done", "push_commit": "push_committed", "push_abort": "done",
        "submit": "job", "fetch": "fetching", "wait": "job", "cancel": "job", "remove": "done", "jobs_request": "jobs",
        "datasets_request": "datasets", "plan_request": "plan", "info_request": "probed", "dataset_create": "done",
        "dataset_change": "datasets", "log_request": "log", "files_request": "files", "places_request": "places",
    }

    def ask(self, body, value, fd=-1):
        value, got = self.answer(self.send(body, value, fd), self.ANSWERS[body])
        if got >= 0 and body != "fetch":
            os.close(got)
            raise Breach("a descriptor came with the answer to " + body)
        return (value, got) if body == "fetch" else value

    def ping(self):
        start = time.monotonic()
        self.ask("ping", pb.Ping())
        return time.monotonic() - start

    def push(self, paths, dataset="", planar=False, crop=()):
        """All files into a dataset; the PushCommitted."""
        begun = self.ask("push_begin", pb.PushBegin(dataset=dataset, planar=planar, crop=crop))
        files = [(p, os.open(p, os.O_RDONLY | os.O_CLOEXEC)) for p in paths]
        try:
            for path, fd in files:
                self.ask("probe", pb.Probe(push=begun.push, name=path), fd)
            self.ask("push_plan", pb.PushPlan(push=begun.push))
            for path, fd in files:
                self.ask("file", pb.File(push=begun.push, name=path), fd)
        finally:
            for _, fd in files:
                os.close(fd)
        return self.ask("push_commit", pb.PushCommit(push=begun.push))

    def wait(self, job):
        """Until the job is final."""
        request = self.send("wait", pb.Wait(job=job, watch=True))
        while True:
            value, _ = self.answer(request, "job")
            if value.final:
                return value

    def fetch(self, job, since=0, system=False):
        """The whole mesh of a job, or what differs from that of generation `since`; checked."""
        _, fd = self.ask("fetch", pb.Fetch(job=job, changed_since=since, system=system))
        try:
            return Mesh(PipeReader(fd, self.wire.timeout))
        finally:
            os.close(fd)


# ---- the mesh stream ----

class PipeReader:
    """Bytes from a descriptor that may be non-blocking."""

    def __init__(self, fd, timeout):
        if not stat.S_ISFIFO(os.fstat(fd).st_mode):
            raise Breach("the mesh comes by something that is no pipe")
        self.fd, self.timeout = fd, timeout

    def read(self, n):
        while True:
            if not select.select([self.fd], [], [], self.timeout)[0]:
                raise TimeoutError("the mesh stream stands still")
            try:
                return os.read(self.fd, n)
            except BlockingIOError:
                continue


def read_all(source, n):
    data = bytearray()
    while len(data) < n:
        part = source.read(n - len(data))
        if not part:
            break
        data += part
    return bytes(data)


TRIANGLE, VERTEX = struct.Struct("<6q").pack, struct.Struct("<3q").pack


class Digest:
    """Sums of XXH3-128, high and low halves apart."""

    def __init__(self):
        import xxhash
        self.of = xxhash.xxh3_128_intdigest
        self.high = self.low = 0

    def add(self, data):
        value = self.of(data)
        self.high += value >> 64
        self.low += value & U64

    def add_triangle(self, a, b, c):
        self.add(TRIANGLE(a[0], a[1], b[0], b[1], c[0], c[1]))

    def __str__(self):
        return "%016x%016x" % (self.high & U64, self.low & U64)


class Fields:
    """A payload, read from its start."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, fmt):
        values = struct.unpack_from("<" + fmt, self.data, self.at)
        self.at += struct.calcsize("<" + fmt)
        return values[0] if len(values) == 1 else values

    def rows(self, fmt, count):
        size = struct.calcsize("<" + fmt)
        if self.at + size * count > len(self.data):
            raise Breach("an array runs over the end of its frame")
        rows = list(struct.iter_unpack("<" + fmt, self.data[self.at:self.at + size * count]))
        self.at += size * count
        return rows

    def text(self):
        n = self.take("H")
        if self.at + n > len(self.data):
            raise Breach("a text runs over the end of its frame")
        self.at += n
        return self.data[self.at - n:self.at].decode()

    def left(self):
        return len(self.data) - self.at

    def end(self):
        rest = self.data[self.at:]
        if len(rest) >= 8 or any(rest):
            raise Breach("%d bytes are left in a frame" % len(rest))


class JobFailed(Fault):
    def __init__(self, code, message):
        super().__init__("%s: %s" % (code, message))
        self.code = code


class Base:
    """The mesh to which changes are applied."""


class Mesh:
    """Reads a stream to its end and checks it."""

    def __init__(self, source):
        self.source = source
        self.positions, self.triangles, self.indexes = [], [], []
        self.absolute = []     # positions with what the lattice adds to them
        self.ended = set()     # vertices that were marked final
        self.regions = {}      # triangles as three absolute positions, by region
        self.base, self.gone = None, {}  # of changes; (triangles, digest) by region
        self.digest, self.vertex_digest = Digest(), Digest()
        self.done = False
        kind, payload = self.frame()
        if kind != 1:
            raise Breach("the stream starts with a frame of type %d" % kind)
        self.read_head(Fields(payload))
        while not self.done:
            kind, payload = self.frame()
            if kind == 2:
                self.read_block(Fields(payload))
            elif kind == 3:
                self.read_tail(Fields(payload))
            elif kind == 4 and self.kind == 3 and not self.base:
                self.read_base(Fields(payload))
            elif kind == 5 and self.base and not self.indexes:
                self.read_gone(Fields(payload))
            else:
                raise Breach("a frame of type %d" % kind)
        if read_all(source, 1):
            raise Breach("the stream goes on after its tail")

    def frame(self):
        import xxhash
        header = read_all(self.source, 32)
        if len(header) < 32:
            raise Breach("the stream ended before its tail")
        magic, version, kind, length, checksum, own = struct.unpack("<IHHQQQ", header)
        if magic != 0x53554341 or own != xxhash.xxh3_64_intdigest(header[:24]) or version != 1:
            raise Breach("bad header %s" % header.hex())
        if length % 8 or not 8 <= length <= 1 << 30:
            raise Breach("a payload of %d bytes" % length)
        payload = read_all(self.source, length)
        if len(payload) < length:
            raise Breach("the stream ended inside a frame")
        if xxhash.xxh3_64_intdigest(payload) != checksum:
            raise Breach("the checksum of a frame is wrong")
        return kind, payload

    def read_head(self, f):
        self.kind, zero = f.take("B7s")
        if any(zero) or self.kind not in (1, 2, 3):
            raise Breach("a stream of kind %d" % self.kind)
        self.stream_id = "%016x%016x" % f.take("QQ")
        self.box = f.take("6i")
        self.lattice, self.crs, self.unit_xy, self.unit_z, self.view = (f.text() for _ in range(5))
        self.geoid, self.wkt = (f.text(), f.text()) if f.left() >= 4 else ("", "")
        f.end()
        words = self.lattice.split(" ")
        self.scales, self.k = words[:2], [int(w) for w in words[2:]]
        if len(self.k) != 3:
            raise Breach("the lattice is %r" % self.lattice)

    def read_base(self, f):
        b = self.base = Base()
        b.generation, b.job = f.take("2Q")
        b.old_digest, b.old_vertex_digest, b.digest, b.vertex_digest = ("%016x%016x" % f.take("QQ") for _ in range(4))
        b.gone, b.gone_triangles, b.kept, b.kept_triangles = f.take("4Q")
        f.end()

    def read_gone(self, f):
        if len(f.data) % 56:
            raise Breach("a list of regions of %d bytes" % len(f.data))
        for x1, y1, x2, y2, triangles, high, low in f.rows("4qQQQ", len(f.data) // 56):
            region = (x1, y1, x2, y2)
            if region in self.gone or not triangles or x1 >= x2 or y1 >= y2:
                raise Breach("the region %s is gone twice, or is none" % (region,))
            self.gone[region] = (triangles, "%016x%016x" % (high, low))

    def check_gone(self):
        said = (self.base.gone, self.base.gone_triangles) if self.base else None
        if self.kind == 3 and said != (len(self.gone), sum(n for n, _ in self.gone.values())):
            raise Breach("%s regions and triangles are gone by the base, not by the lists" % (said,))

    def read_block(self, f):
        index, *region = f.take("Q4q")
        self.check_gone()
        self.region = self.regions.setdefault(tuple(region), [])
        first, nforeign, nnew, ntriangle, flags = f.take("QIIII")
        if self.indexes and index < self.indexes[-1]:
            raise Breach("block %d after block %d" % (index, self.indexes[-1]))
        if any(v % 2 == 0 for v in region if abs(v) < (1 << 63) - 1 and v != -(1 << 63)):
            raise Breach("the region %s has an even border" % region)
        if first != len(self.positions) or flags > 1:  # origins are for views with hidden alone
            raise Breach("block %d numbers from %d, flags %d" % (index, first, flags))
        self.indexes.append(index)
        foreign = [n for n, in f.rows("Q", nforeign)]
        new = f.rows("3i", nnew)
        triangles = f.rows("3I", ntriangle)
        if flags & 1:
            f.rows("B", ntriangle)
        final = [b for b, in f.rows("B", (nforeign + nnew + 7) // 8)]
        f.end()
        numbers = foreign + list(range(first, first + nnew))
        if any(n >= first or n in self.ended for n in foreign):
            raise Breach("block %d uses vertices that are to come or were final" % index)
        (x1, y1, z1, x2, y2, z2), (kx, ky, kz) = self.box, self.k
        for x, y, z in new:
            if not (x1 <= x <= x2 and y1 <= y <= y2 and z1 <= z <= z2):
                raise Breach("vertex %s is outside the head's box" % ((x, y, z),))
            self.absolute.append((x + kx, y + ky, z + kz))
            self.vertex_digest.add(VERTEX(x + kx, y + ky, z + kz))
        self.positions += new
        for t in triangles:
            self.add_triangle([numbers[i] for i in t])
        for i, byte in enumerate(final):
            for bit in range(8):
                if byte >> bit & 1:
                    self.ended.add(numbers[8 * i + bit])

    def add_triangle(self, t):
        if len(set(t)) != 3:
            raise Breach("triangle %s" % t)
        a, b, c = [self.absolute[n] for n in t]
        if b < a or c < a:
            a, b, c = (b, c, a) if b < c else (c, a, b)
        if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0:
            raise Breach("triangle %s is not counter-clockwise" % t)
        self.digest.add_triangle(a, b, c)
        self.triangles.append(t)
        self.region.append((a, b, c))

    def read_tail(self, f):
        failed, zero = f.take("B7s")
        blocks, vertices, triangles, self.hull = f.take("4Q")
        box = f.take("6i")
        digest, vertex_digest = "%016x%016x" % f.take("QQ"), "%016x%016x" % f.take("QQ")
        code, message, hint, self.report = (f.text() for _ in range(4))
        f.end()
        if failed:
            raise JobFailed(code, message)
        self.check_gone()
        said = (blocks, vertices, triangles, digest, vertex_digest)
        came = (len(self.indexes), len(self.positions), len(self.triangles), str(self.digest), str(self.vertex_digest))
        if said != came:
            raise Breach("the tail says %s, but %s came" % (said, came))
        if vertices and box != tuple(f(p[a] for p in self.positions) for f in (min, max) for a in range(3)):
            raise Breach("the tail's box is %s" % (box,))
        if self.kind == 1 and triangles and len(self.positions) - len(self.ended) != self.hull:
            raise Breach("%d vertices never became final, the hull has %d" %
                         (len(self.positions) - len(self.ended), self.hull))
        self.done = True
