// Mouse, touch, pen and keys on the surface.

class Input {
	constructor(page) {
		const canvas = this.canvas = $("scene"), on = (name, f) => canvas.addEventListener(name, f, {passive: false});

		this.page = page;
		this.pointers = new Map();
		on("pointerdown", e => this.down(e));
		on("pointermove", e => this.move(e));
		on("pointerup", e => this.up(e, true));
		on("pointercancel", e => this.up(e, false));
		on("pointerleave", () => !this.pointers.size && page.point(null));
		on("wheel", e => this.wheel(e));
		on("contextmenu", e => e.preventDefault());
		on("dblclick", e => this.twice(e));
		document.addEventListener("keydown", e => this.key(e));
	}

	down(e) {
		this.canvas.focus({preventScroll: true});
		this.canvas.setPointerCapture(e.pointerId);
		this.pointers.set(e.pointerId, {x: e.offsetX, y: e.offsetY});
		if (this.pointers.size === 1)
			this.drag = {x: e.offsetX, y: e.offsetY, far: false, other: e.button !== 0 || e.shiftKey || e.ctrlKey, first: e.button === 0};
		else if (this.drag)
			this.drag.far = true; // no click any more
	}

	move(e) {
		const was = this.pointers.get(e.pointerId), {page, drag} = this, {camera} = page;

		if (!was || !drag) {
			page.point([e.offsetX, e.offsetY]);
			return;
		}
		const now = {x: e.offsetX, y: e.offsetY}, dx = now.x - was.x, dy = now.y - was.y;
		if (this.pointers.size > 1) {
			this.two(e.pointerId, was, now);
		} else {
			const least = e.pointerType === "mouse" ? 4 : 9;
			if (!drag.far && Math.hypot(now.x - drag.x, now.y - drag.y) < least)
				return; // perhaps a click
			drag.far = true;
			this.canvas.classList.add("dragging");
			// From above the mesh is a map, which one moves; else it is a body, which one turns.
			if (drag.other !== camera.parallel)
				camera.pan(dx, dy);
			else
				camera.turn(dx, dy);
		}
		this.pointers.set(e.pointerId, now);
		page.update();
	}

	// Two fingers: their middle moves the mesh, their distance is the size, their direction turns it.
	two(id, was, now) {
		const [, other] = [...this.pointers].find(([other]) => other !== id), {camera} = this.page;
		const length = p => Math.hypot(p.x - other.x, p.y - other.y), angle = p => Math.atan2(p.y - other.y, p.x - other.x);

		camera.pan((now.x - was.x) / 2, (now.y - was.y) / 2);
		if (length(was) > 20 && length(now) > 20) {
			const turned = angle(now) - angle(was);
			camera.zoom(length(was) / length(now), null);
			camera.yaw += turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI));
		}
	}

	up(e, whole) {
		const drag = this.drag;

		this.pointers.delete(e.pointerId);
		this.canvas.classList.remove("dragging");
		if (this.pointers.size)
			return;
		this.drag = null;
		if (drag && drag.far) {
			this.page.camera.refocus();
			this.page.update();
		} else if (drag && drag.first && whole) {
			const last = this.clicked, now = this.clicked = {x: e.offsetX, y: e.offsetY, time: e.timeStamp};
			this.page.click([now.x, now.y], last && now.time - last.time < 400 && Math.hypot(now.x - last.x, now.y - last.y) < 10);
		}
		if (e.pointerType !== "mouse")
			this.page.point(null); // nothing is there any more
	}

	wheel(e) {
		const {page} = this, lines = [1, 16, 400][e.deltaMode] || 1;

		e.preventDefault();
		page.camera.zoom(Math.exp(Math.max(-1, Math.min(1, e.deltaY * lines * 0.0016))), page.placeAt([e.offsetX, e.offsetY]));
		page.update();
	}

	// The place that is clicked twice goes to the middle.
	twice(e) {
		const {page} = this, place = page.tools.name ? null : page.placeAt([e.offsetX, e.offsetY]);

		if (!place)
			return;
		page.camera.target = place;
		page.camera.zoom(0.6, null);
		page.update();
	}

	key(e) {
		const {page} = this, {camera, tools} = page, far = 40;

		// Controls keep the focus after they were used, and need no other of these keys.
		const own = /^(SELECT|INPUT)$/.test(e.target.tagName) && e.key.startsWith("Arrow");
		if (own || e.ctrlKey || e.metaKey || e.altKey || $("about").open)
			return;
		const arrow = {ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[e.key];
		const keys = {
			"+": () => camera.zoom(0.8, null), "=": () => camera.zoom(0.8, null), "-": () => camera.zoom(1.25, null),
			r: () => page.view("reset"), t: () => page.view("top"), n: () => camera.yaw = 0,
			d: () => tools.choose("distance"), p: () => tools.choose("profile"), l: () => page.otherTheme(),
			c: () => page.toggle("contours"), w: () => page.toggle("wire"), Backspace: () => tools.undo(),
			Escape: () => page.escape(), 1: () => page.chooseMode(0), 2: () => page.chooseMode(1), 3: () => page.chooseMode(2), 4: () => page.chooseMode(3),
		};
		const act = keys[e.key.length === 1 ? e.key.toLowerCase() : e.key];

		if (arrow && e.shiftKey)
			camera.turn(arrow[0] * far / 2, arrow[1] * far / 2);
		else if (arrow)
			camera.pan(arrow[0] * far, arrow[1] * far);
		else if (act)
			act();
		else
			return;
		e.preventDefault();
		page.update();
	}
}
