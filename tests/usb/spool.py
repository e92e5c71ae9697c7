"""A second reader of spools, written from spool.md alone."""
import hashlib
import struct

try:
    import xxhash
except ImportError:
    from bus import unavailable
    unavailable("no xxhash for Python (package python3-xxhash)")

DATA, EVENT, CLOCK, SENT, END = 1, 2, 3, 4, 5
SHORT, AFTER_GAP, WITH_ERROR = 1, 2, 4


class Bad(Exception):
    pass


def check(data, seed=0):
    return xxhash.xxh3_64_intdigest(data, seed=seed)


class Record:
    def __init__(self, kind, flags, number, time_ns, payload):
        self.kind, self.flags, self.number, self.time_ns, self.payload = kind, flags, number, time_ns, payload


class Spool:
    def __init__(self, path):
        with open(path, "rb") as f:
            self.raw = f.read()
        self.read_head()
        self.records, self.end, at = [], None, 2 * self.size
        while at < len(self.raw):
            record = self.read_record(at)
            if not record:
                break
            if record.number != len(self.records):
                raise Bad("record %d where %d should stand" % (record.number, len(self.records)))
            if self.end:
                raise Bad("something stands behind END")
            if record.kind == END:
                self.end = record
            self.records.append(record)
            at += 40 + len(record.payload)
        self.torn = len(self.raw) - at
        if self.end:
            self.read_end()

    def read_head(self):
        raw = self.raw
        if raw[:8] != b"\x89ACUTSP\n":
            raise Bad("no spool")
        version, self.size, want = struct.unpack_from("<IIQ", raw, 8)
        if version != 1 or self.size % 4096 or self.size > 131072:
            raise Bad("version %d, head of %d" % (version, self.size))
        for at in (0, self.size):
            head = raw[at:at + self.size]
            if check(head[:16] + bytes(8) + head[24:]) != want:
                raise Bad("the head at %d is broken" % at)
        self.id = raw[24:40]
        self.seed = check(self.id)
        self.vendor, self.product = struct.unpack_from("<HH", raw, 40)
        self.utc_ns, self.monotonic_ns = struct.unpack_from("<qq", raw, 48)
        at, texts = 64, []
        for _ in range(6):
            n = struct.unpack_from("<H", raw, at)[0]
            texts.append(raw[at + 2:at + 2 + n].decode())
            at += 2 + n
        self.manufacturer, self.model, self.serial, self.port, self.profile_name, self.boot = texts
        n = struct.unpack_from("<I", raw, at)[0]
        self.profile = raw[at + 4:at + 4 + n].decode()

    def read_record(self, at):
        head = self.raw[at:at + 40]
        if len(head) < 40 or head[:4] != b"REC\x1e":
            return None
        low, kind, flags, zero, n, number, time_ns, payload_check = struct.unpack_from("<IBBHIQqQ", head, 4)
        payload = self.raw[at + 40:at + 40 + n]
        if low != check(head[8:40], self.seed) & 0xffffffff or len(payload) < n or check(payload, self.seed) != payload_check:
            return None
        if zero:
            raise Bad("byte 10 is not zero")
        return Record(kind, flags, number, time_ns, payload)

    def read_end(self):
        records, transfers, size, events = struct.unpack_from("<QQQQ", self.end.payload)
        before = self.records[:-1]
        if (records, transfers, size, events) != (len(before), len(self.data()), len(self.bytes()), len(self.events())):
            raise Bad("END counts otherwise: %s" % ((records, transfers, size, events),))
        if self.end.payload[32:64] != hashlib.sha256(self.bytes()).digest():
            raise Bad("END has another SHA-256")

    def data(self):
        return [r for r in self.records if r.kind == DATA]

    def bytes(self):
        return b"".join(r.payload for r in self.data())

    def events(self):
        return [r.payload.decode() for r in self.records if r.kind == EVENT]

    def words(self):
        return [e.split()[0] for e in self.events()]

    def sha256(self):
        return hashlib.sha256(self.bytes()).hexdigest()

    def gaps(self):
        """Places in the stream of DATA that are marked as behind a gap."""
        at, places = 0, []
        for r in self.records:
            if r.kind == DATA:
                if r.flags & AFTER_GAP:
                    places.append(at)
                at += len(r.payload)
        return places


def cut_again(spool, path, pieces):
    """The same capture with each transfer split into several records of the same time, as another bus might have split it."""
    out = bytearray(spool.raw[:2 * spool.size])
    number = transfers = events = 0
    whole = spool.bytes()

    def put(kind, flags, time_ns, payload):
        nonlocal number
        rest = struct.pack("<BBHIQqQ", kind, flags, 0, len(payload), number, time_ns, check(payload, spool.seed))
        out.extend(b"REC\x1e" + struct.pack("<I", check(rest, spool.seed) & 0xffffffff) + rest + payload)
        number += 1

    for r in spool.records:
        if r.kind == DATA:
            step = max(1, -(-len(r.payload) // pieces))
            for at in range(0, len(r.payload), step):
                put(DATA, r.flags & ~SHORT if at == 0 else 0, r.time_ns, r.payload[at:at + step])
                transfers += 1
        elif r.kind == END:
            put(END, 0, r.time_ns, struct.pack("<QQQQ", number, transfers, len(whole), events) + hashlib.sha256(whole).digest())
        else:
            events += r.kind == EVENT
            put(r.kind, r.flags, r.time_ns, r.payload)
    with open(path, "wb") as f:
        f.write(out)
    Spool(path)
