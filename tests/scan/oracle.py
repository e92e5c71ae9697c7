"""acut-scan's points compared with the geometry of drive.py, shot by shot, within the rounding of the file."""
import os

import drive
from drive import Drive, Survey, scan, spool
from e2e import Folder, expect, main


def compare(points, want, most=0.00051):
    expect(len(points) == len(want), "%d points, not %d" % (len(points), len(want)))
    worst = max(abs(a - b) for p, q in zip(points, want) for a, b in zip(p, q))
    expect(worst <= most, "off by %.6f" % worst)


def in_the_plane():
    with Folder() as base:
        d = Drive()
        s = Survey(d, 40)
        out = os.path.join(base, "o.las")
        got = scan("push", spool(base + "/a.spool", s.records), "--pose", d.csv(base + "/p.csv"), "-o", out, "--json").ok().json()
        points, times, head = drive.read_las(out)
        compare(points, s.points)
        expect(got["points"] == len(points) and got["shots"] == s.shots, str(got))
        expect(times == sorted(times) and abs(times[0] - (drive.START + 0.05 - 315964800 + 18 - 1e9)) < 0.04, "times %r" % times[:2])
        # twice the same bytes, whatever the name and the day
        os.rename(base + "/a.spool", base + "/b.spool")
        scan("push", base + "/b.spool", "--pose", d.csv(base + "/q.csv"), "-o", base + "/o2.las").ok()
        expect(open(out, "rb").read() == open(base + "/o2.las", "rb").read(), "other bytes")
        refused = scan("push", base + "/b.spool", "--pose", base + "/q.csv", "-o", out)
        expect(refused.status == 2 and "there already" in refused.err, refused.err)


def in_degrees():
    for where, zone in (((48.2, 11.6), 32), ((-33.9, 18.4), 34), ((61.0, 5.2), 32)):
        with Folder() as base:
            d = Drive(2.2, where=where)
            s = Survey(d, 25, zone, flat=300)
            out = os.path.join(base, "o.las")
            got = scan("push", spool(base + "/a.spool", s.records), "--pose", d.csv(base + "/p.csv", end="\r\n"), "-o", out,
                       "--json").ok().json()
            number = (32600 if where[0] > 0 else 32700) + zone
            expect(got["crs"] == "EPSG:%d + EPSG:5030" % number and got["heights"] == "ellipsoidal", str(got))
            points, _, _ = drive.read_las(out)
            compare(points, s.points, 0.00052)
            expect(max(abs(p[2] - 300) for p in points) < 0.001, "the floor is not flat")


def without_pose():
    """Shots before, after and in a gap of the poses are dropped and counted."""
    with Folder() as base:
        d = Drive(3.0)
        s = Survey(d, 85, first=-0.2)
        out = os.path.join(base, "o.las")
        full = d.poses
        d.poses = [p for p in full if not 1.0 < p[0] - drive.START < 1.8]
        gapped = Survey(d, 85, first=-0.2)
        path = spool(base + "/a.spool", s.records)
        # the gap is below the limit of 1.5 s: it is bridged
        got = scan("push", path, "--pose", d.csv(base + "/p.csv"), "-o", out, "--json").ok().json()
        expect(got["dropped"]["in_gaps"] == 0 and got["dropped"]["before_poses"] > 200 and got["dropped"]["after_poses"] > 200, str(got))
        expect(got["shots"] == got["points"] + sum(got["dropped"].values()), str(got))
        got = scan("push", path, "--pose", base + "/p.csv", "-o", out + "2", "--gap", "0.5", "--json").ok().json()
        missing = [i for i in range(len(full)) if full[i] not in d.poses]
        expect(missing and got["dropped"]["in_gaps"] > 1000, str(got))
        expect(gapped.shots == got["shots"], "shots")
        late = scan("push", path, "--pose", base + "/p.csv", "-o", out + "3", "--pose-offset", "1000")
        expect(late.status == 1 and "no shot has a pose" in late.err and "--pose-offset" in late.err, late.err)
        late = scan("push", path, "--pose", base + "/p.csv", "-o", out + "3", "--pose-clock", "gps")
        expect(late.status == 1, late.err)


def clocks():
    """GPS times, and a wall clock that was set during the capture."""
    with Folder() as base:
        d = Drive(3.0)
        s = Survey(d, 20)
        path = spool(base + "/a.spool", s.records)
        want = os.path.join(base, "want.las")
        scan("push", path, "--pose", d.csv(base + "/p.csv"), "-o", want).ok()
        want = drive.read_las(want)[0]
        for p in d.poses:
            p[0] = round(p[0] - 315964800 + 18 - 1e9, 6)
        scan("push", path, "--pose", d.csv(base + "/g.csv"), "--pose-clock", "gps", "-o", base + "/gps.las").ok()
        compare(drive.read_las(base + "/gps.las")[0], want, 0.00101)
        # the head's clock was 100 s late; it was set right before the first sweep
        clock = (drive.CLOCK, 10, (int(drive.START * 1e9) + 10).to_bytes(8, "little"))
        wrong = spool(base + "/c.spool", [clock] + s.records, None, "ff" * 16, drive.START - 100)
        scan("push", wrong, "--pose", base + "/p.csv", "-o", base + "/clock.las").ok()
        compare(drive.read_las(base + "/clock.las")[0], want, 0.00101)


if __name__ == "__main__":
    main(in_the_plane, in_degrees, without_pose, clocks)
