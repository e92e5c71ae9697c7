"""Drives Debian's chromium through pipes, by the protocol of its developer tools: no package but the browser is needed. with Browser(folder)
as b: b.open(path); b.value("document.title"); b.click(x, y)."""
import base64
import json
import os
import select
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
from e2e import PATIENCE, Fault, expect, until  # noqa: E402

FLAGS = ["--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
         "--no-first-run", "--disable-dev-shm-usage", "--disable-extensions", "--disable-background-networking", "--disable-component-update", "--disable-sync"]


class Browser:
    def __init__(self, folder):
        self.folder, self.id, self.buffer, self.session = folder, 0, b"", None
        self.requests, self.said = [], []  # URLs; errors of the page and the console

    def __enter__(self):
        to_read, self.to = os.pipe()
        self.back, from_write = os.pipe()

        def pipes():
            os.dup2(to_read, 103)
            os.dup2(from_write, 104)
            os.dup2(103, 3)
            os.dup2(104, 4)

        home = os.path.join(self.folder, "browser")
        os.makedirs(home)
        with open(os.path.join(self.folder, "browser.log"), "wb") as log:
            self.process = subprocess.Popen(["chromium", *FLAGS, "--user-data-dir=" + home, "about:blank"], stdin=subprocess.DEVNULL, stdout=log,
                                            stderr=log, close_fds=False, preexec_fn=pipes, env={**os.environ, "HOME": home})
        os.close(to_read)
        os.close(from_write)
        self.attach()
        return self

    def __exit__(self, *exc):
        try:
            self.session = None
            self.call("Browser.close")
        except (Fault, OSError):
            pass
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.to)
        os.close(self.back)

    def attach(self):
        pages = until(lambda: [t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page"], "chromium has no page")
        self.session = self.call("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(domain + ".enable")

    # ---- messages ----

    def call(self, method, **params):
        self.id += 1
        message = {"id": self.id, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0") if len(json.dumps(message)) < 60000 else self.long(message)
        deadline = time.monotonic() + PATIENCE
        while True:
            answer = self.message(deadline)
            if answer.get("id") == self.id:
                expect("error" not in answer, "%s: %s" % (method, answer.get("error")))
                return answer["result"]

    def long(self, message):
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self.to, data):]

    def message(self, deadline):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.back], [], [], max(0, deadline - time.monotonic()))
            expect(ready, "chromium does not answer")
            data = os.read(self.back, 1 << 20)
            expect(data, "chromium ended")
            self.buffer += data
        text, self.buffer = self.buffer.split(b"\0", 1)
        message = json.loads(text)
        self.event(message.get("method"), message.get("params"))
        return message

    def event(self, name, p):
        if name == "Network.requestWillBeSent":
            self.requests.append(p["request"]["url"])
        elif name == "Runtime.exceptionThrown":
            self.said.append(p["exceptionDetails"].get("exception", {}).get("description") or p["exceptionDetails"]["text"])
        elif name == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning", "assert"):
            self.said.append("console: %s" % [a.get("value", a.get("description")) for a in p["args"]])
        elif name == "Log.entryAdded" and p["entry"]["level"] in ("error", "warning"):
            self.said.append("%s: %s" % (p["entry"]["source"], p["entry"]["text"]))

    # ---- the page ----

    def open(self, path):
        self.value("window.left = true")  # until the next page is there
        self.call("Page.navigate", url="file://" + path)

    def ready(self):
        """Waits until the page has its mesh, or has said why not; true if it has."""
        until(lambda: self.value("document.readyState === 'complete' && Boolean(window.acut) && !window.left"), "the page runs no script")
        return self.value("acut.ready")

    def value(self, expression):
        """Of an expression in the page; of its promise."""
        r = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        expect("exceptionDetails" not in r, "%s: %s" % (expression[:80], r.get("exceptionDetails")))
        return r["result"].get("value")

    def seconds(self):
        """CPU time of the page's thread, which other programs do not lengthen."""
        self.call("Performance.enable", timeDomain="threadTicks")
        return next(m["value"] for m in self.call("Performance.getMetrics")["metrics"] if m["name"] == "ThreadTime")

    def size(self, width, height, mobile=False, ratio=1):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=mobile)
        self.call("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type="mouse" + kind, x=x, y=y, **more)

    def click(self, x, y):
        self.mouse("Moved", x, y)
        self.mouse("Pressed", x, y, button="left", clickCount=1)
        self.mouse("Released", x, y, button="left", clickCount=1)

    def touch(self, kind, *points):
        self.call("Input.dispatchTouchEvent", type="touch" + kind, touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)])

    def key(self, key):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, **({"text": key} if kind == "keyDown" and len(key) == 1 else {}))

    def picture(self, path):
        with open(path, "wb") as f:
            f.write(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
