"""ctypes and the compiler have the same size of every struct of acut.h, and the same offset of every field. Every code of
base/err.def has its exception."""
import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile

import acut
from acut import _abi

SOURCE = os.environ["ACUT_SOURCE"]


def layouts():
    cc = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
    if not cc:
        print("skipped: there is no C compiler (layouts)")
        return
    structs = {n: c for n, c in vars(_abi).items()
               if isinstance(c, type) and issubclass(c, ctypes.Structure) and c is not ctypes.Structure}
    assert len(structs) > 40, len(structs)
    rows = []
    for name, struct in structs.items():
        rows.append('printf("%s %%zu\\n", sizeof(struct %s));' % (name, name))
        rows += ['printf("%s.%s %%zu\\n", offsetof(struct %s, %s));' % (name, f, name, f) for f, _ in struct._fields_]
    with tempfile.TemporaryDirectory(prefix="acut-abi-") as folder:
        source, program = os.path.join(folder, "a.c"), os.path.join(folder, "a")
        with open(source, "w") as f:
            f.write('#include <stdio.h>\n#include "acut.h"\nint main(void)\n{\n%s\n}\n' % "\n".join(rows))
        subprocess.run([cc, "-I", os.path.join(SOURCE, "client/libacut"), "-o", program, source], check=True)
        out = subprocess.run([program], stdout=subprocess.PIPE, check=True).stdout.decode()
    for line in out.splitlines():
        what, number = line.split()
        struct, _, field = what.partition(".")
        have = getattr(structs[struct], field).offset if field else ctypes.sizeof(structs[struct])
        assert have == int(number), "%s: C has %s, ctypes %d" % (what, number, have)
    with open(os.path.join(SOURCE, "client/libacut/acut.h")) as f:
        defined = re.findall(r"^struct (\w+) \{", f.read(), re.M)
    assert sorted(defined) == sorted(structs), set(defined) ^ set(structs)
    print("ok   %d structs, %d places" % (len(structs), len(out.splitlines())))


def codes():
    with open(os.path.join(SOURCE, "base/err.def")) as f:
        rows = re.findall(r'^ERR\(\w+,\s*"([^"]+)",\s*(\d+),', f.read(), re.M)
    classes = {c.code: c for c in vars(acut).values() if isinstance(c, type) and issubclass(c, acut.Error) and c is not acut.Error}
    assert len(rows) > 20 and sorted(n for n, _ in rows) == sorted(classes), {n for n, _ in rows} ^ set(classes)
    for name, status in rows:
        assert classes[name].exit_status == int(status), name
        e = classes[name]("m", hint="h", file="f", offset=3, field="g")
        assert str(e) == "f: byte 3, g: m (h)", e
    print("ok   %d codes" % len(rows))


def described():
    """Everything public has a docstring."""
    text = subprocess.run([sys.executable, "-m", "pydoc", "acut"], stdout=subprocess.PIPE, check=True).stdout.decode()
    assert "with acut.connect() as server" in text and "class Connection" in text
    for name in acut.__all__:
        assert getattr(acut, name) is not None
        assert isinstance(getattr(acut, name), str) or getattr(acut, name).__doc__, name
    for name, f in vars(acut.Connection).items():
        assert name.startswith("_") or f.__doc__, "Connection.%s has no docstring" % name
    print("ok   %d names" % len(acut.__all__))


def other_libraries():
    """A missing or wrong library is an error before any function of it is called."""
    for path, want in (("/nowhere/libacut.so.0", "ImportError: libacut cannot be loaded"), ("libm.so.6", "VersionError: libm.so.6 is libacut older")):
        p = subprocess.run([sys.executable, "-c", "import acut; acut.connect('/nowhere')"], stderr=subprocess.PIPE,
                           env=dict(os.environ, ACUT_LIBRARY=path))
        assert p.returncode == 1 and want in p.stderr.decode(), p.stderr.decode()
    _abi.VERSION, version = "0.99.0", _abi.VERSION
    try:
        acut.connect("/nowhere")
        raise SystemExit("a library of another release was taken")
    except acut.VersionError as e:
        assert e.exit_status == 76 and version in str(e), e
    _abi.VERSION = version
    print("ok   other libraries")


layouts()
codes()
described()
other_libraries()
