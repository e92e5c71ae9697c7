// The page: reads the mesh, and joins all parts.

const $ = id => document.getElementById(id);
const MODES = ["hillshade", "elevation", "slope", "domains"];
const EXAGGERATIONS = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 15, 20];

class Page {
	constructor(mesh) {
		const surface = mesh.levels || new Surface(mesh), {facts} = mesh;

		this.mesh = mesh;
		this.surface = surface;
		this.axes = facts.axes.map((fact, axis) => new Axis(fact, surface.middle[axis]));
		this.units = new Units((facts.comments["acut-units"] || "").split(" "), this.axes[1].base + originOf(facts)[1]);
		this.step = this.axes.map((axis, i) => axis.step * this.units.scale[i]);
		this.camera = new Camera(surface, this.step);
		this.scene = new Scene($("scene"), surface, this.step);
		this.items = mesh.levels ? [] : [{part: new Part(mesh), domains: mesh.domains}];
		this.overlay = new Overlay($("marks"));
		this.pointer = null; // where it is, in pixels
		this.pinned = null; // the place that was clicked last, without a tool
		this.heights = usualHeights(mesh.levels ? mesh.levels.sample() : mesh).map(n => this.axes[2].base + this.axes[2].local(n - surface.middle[2]));
		this.begin();
	}

	begin() {
		const [low, high] = this.heights, {levels} = this.mesh;

		this.scene.state.range = high > low ? [low, high] : [low - 0.5, low + 0.5];
		this.intervals();
		this.tools = new Tools(this);
		this.input = new Input(this);
		this.controls();
		this.resize();
		this.camera.reset();
		new ResizeObserver(() => this.resize()).observe($("scene"));
		matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.themed());
		$("scene").addEventListener("webglcontextlost", e => e.preventDefault());
		$("scene").addEventListener("webglcontextrestored", () => {
			this.scene.restore();
			this.update();
		});
		if (levels)
			levels.changed = () => this.update();
		this.changed();
		this.draw();
	}

	// ---- controls ----

	controls() {
		const {tools, camera, scene} = this, on = (id, name, f) => $(id).addEventListener(name, f);

		$("modes").addEventListener("change", e => this.chooseMode(MODES.indexOf(e.target.value)));
		$("modes").querySelector("[value=domains]").closest("label").hidden = this.mesh.domains.length < 2;
		for (const id of ["contours", "wire", "interval"])
			on(id, "change", () => this.changed());
		$("height").max = EXAGGERATIONS.length - 1;
		on("height", "input", () => this.changed());
		on("fit", "click", () => this.view("reset"));
		on("top", "click", () => this.view(camera.parallel ? "reset" : "top"));
		on("north", "click", () => {
			camera.yaw = 0;
			this.update();
		});
		on("closer", "click", () => this.zoom(0.75));
		on("farther", "click", () => this.zoom(1 / 0.75));
		for (const tool of ["distance", "profile"])
			on(tool, "click", () => tools.choose(tool));
		on("measure-undo", "click", () => tools.undo());
		on("measure-clear", "click", () => {
			tools.corners.distance = [];
			tools.changed();
		});
		on("measure-close", "click", () => tools.close("distance"));
		on("chart-close", "click", () => tools.close("profile"));
		on("chart-copy", "click", () => tools.copy());
		on("chart-save", "click", () => tools.save());
		on("layers", "click", () => this.panel(!$("panel").classList.contains("open")));
		on("scene", "pointerdown", () => this.panel(false));
		scene.state.mode = 1;
	}

	// On small screens the panel is opened by a button.
	panel(open) {
		$("panel").classList.toggle("open", open);
		$("layers").setAttribute("aria-expanded", open);
	}

	// Intervals of contours around the one that suits the heights best.
	intervals() {
		const [low, high] = this.scene.state.range, best = nice((high - low) / 16), select = $("interval");
		let interval = best;

		for (let i = 0; i < 3; i++)
			interval = nice(interval / 2.6);
		for (let i = 0; i < 7; i++, interval = nice(interval * 1.5)) {
			const option = document.createElement("option");
			option.value = interval;
			option.textContent = `every ${interval.toFixed(decimalsOf(interval))}${this.units.z && " " + this.units.z}`;
			option.selected = Math.abs(interval / best - 1) < 1e-6;
			select.append(option);
		}
	}

	chooseMode(mode) {
		const radio = $("modes").querySelector(`[value=${MODES[mode]}]`);

		if (radio.closest("label").hidden)
			return;
		radio.checked = true;
		this.scene.state.mode = mode;
		this.changed();
	}

	toggle(id) {
		$(id).checked = !$(id).checked;
		this.changed();
	}

	view(name) {
		this.camera[name]();
		this.update();
	}

	zoom(factor) {
		this.camera.zoom(factor, null);
		this.update();
	}

	escape() {
		const {tools} = this;

		this.panel(false);
		if (tools.name)
			tools.choose(tools.name);
		else
			["distance", "profile"].forEach(name => tools.close(name));
		this.pinned = null;
		this.update(false);
	}

	// A control has changed.
	changed() {
		const {state} = this.scene, exaggeration = EXAGGERATIONS[$("height").value];

		state.wire = $("wire").checked;
		state.interval = $("contours").checked ? Number($("interval").value) : 0;
		$("interval").disabled = !$("contours").checked;
		$("height-text").textContent = "× " + exaggeration;
		this.camera.exaggeration = exaggeration;
		showLegend(this);
		this.update();
	}

	otherTheme() {
		otherTheme();
		this.themed();
	}

	themed() {
		if (!$("chart").hidden)
			this.tools.chart.draw();
		this.update();
	}

	// ---- places ----

	// The place of the surface at a pixel, or null.
	placeAt(pixel) {
		const hit = this.surface.hit(...this.camera.ray(...pixel)), z = hit && this.surface.find(hit[0], hit[1]).z;

		return hit && [hit[0], hit[1], Number.isNaN(z) ? hit[2] : z];
	}

	// A place gets its exact height, as soon as the triangles there are read.
	async exactly(place) {
		const {levels} = this.mesh, z = levels ? await levels.exact(place[0], place[1]).catch(error => levels.fail(error)) : NaN;

		if (!(Math.abs(z - place[2]) > 0))
			return;
		place[2] = z;
		this.tools.changed();
	}

	// Where the pointer rests the triangles are read, too.
	async rest() {
		const {levels} = this.mesh, place = this.pointer && this.placeAt(this.pointer);

		if (place && levels.find(place[0], place[1]).error) {
			await levels.exact(place[0], place[1]).catch(error => levels.fail(error));
			this.update(false);
		}
	}

	// How far a height may be off, of steps of the lattice, as text.
	within(error) {
		const n = error * this.axes[2].step, digits = Math.max(0, Math.min(this.axes[2].shown, 1 - Math.floor(Math.log10(n))));

		return `to within ${(Math.ceil(n * 10 ** digits) / 10 ** digits).toFixed(digits)}${this.units.z && "\u00a0" + this.units.z}`;
	}

	coordinates(place) {
		return place.map((n, axis) => this.axes[axis].base + this.axes[axis].local(n));
	}

	// The height at coordinates, exact but for the rounding of doubles; NaN outside.
	height(x, y) {
		const at = [x, y].map((n, axis) => this.axes[axis].relative(n - this.axes[axis].base));

		return this.axes[2].base + this.axes[2].local(this.surface.find(at[0], at[1]).z);
	}

	point(pixel) {
		this.pointer = pixel;
		clearTimeout(this.resting);
		if (pixel && this.mesh.levels)
			this.resting = setTimeout(() => this.rest(), 200);
		this.update(false);
	}

	// `again`: the second one of a double click, which is no second corner, though the mesh may have moved after the first one.
	click(pixel, again) {
		const place = this.placeAt(pixel);

		this.pointer = pixel;
		if (again && this.tools.name)
			return;
		if (!this.tools.click(place))
			this.pinned = place;
		if (place && this.pinned === place)
			this.exactly(place);
		this.update(false);
	}

	// ---- the picture ----

	resize() {
		const ratio = window.devicePixelRatio || 1, {camera} = this, canvas = $("scene");

		camera.width = canvas.clientWidth || 1;
		camera.height = canvas.clientHeight || 1;
		camera.covered = camera.width > 720 && camera.height > 480 ? [$("panel").offsetWidth + 12, $(camera.width < 1100 ? "legend" : "tools").offsetWidth + 12] : [0, 0];
		if (camera.fitted)
			camera.fit();
		canvas.width = Math.round(camera.width * ratio);
		canvas.height = Math.round(camera.height * ratio);
		if (this.tools && !$("chart").hidden)
			this.tools.showProfile();
		this.update();
	}

	// Something has changed: a new picture, once. The surface is drawn again only if it looks different, since that takes long where
	// there is no graphics processor.
	update(surface = true) {
		this.stale = this.stale || surface;
		if (!this.waiting)
			this.waiting = requestAnimationFrame(() => this.draw(this.stale));
	}

	draw(surface = true) {
		cancelAnimationFrame(this.waiting);
		this.waiting = 0;
		if (surface) {
			this.stale = false;
			this.drawSurface();
		}
		this.overlay.draw(this.camera, this.tools.paths(), this.tools.spot || this.pinned);
		$("top").setAttribute("aria-pressed", this.camera.parallel);
		$("north").firstChild.style.transform = `rotate(${this.camera.yaw}rad)`;
		this.showScale();
		this.showCursor();
	}

	drawSurface() {
		const {levels} = this.mesh;

		if (!levels) {
			this.scene.draw(this.camera, this.axes[2], this.items);
			return;
		}
		const cut = levels.cut(this.camera, this.scene);
		this.scene.draw(this.camera, this.axes[2], cut.items, cut.drop);
		// Where a grid has no triangle the mesh ends within a diagonal of its quads.
		$("legend-error").textContent = (cut.error ? "Drawn " + this.within(cut.error) : "Drawn exactly") + (cut.waiting ? ", reading \u2026" : "") +
			(cut.border ? `\nUp to ${lengthText(Math.SQRT2 * cut.border * Math.max(...this.step.slice(0, 2)), this.units.length)} may be missing at borders` : "") +
			(cut.error && this.scene.state.wire ? "\nTriangles are shown where it is exact" : "");
		$("legend-error").hidden = false;
	}

	showScale() {
		const pixel = this.camera.pixel(), most = Math.min(130, this.camera.width / 5), length = nice(most * pixel / 2.5);

		$("scale-bar").style.width = length / pixel + "px";
		$("scale-text").textContent = lengthText(length, this.units.length).replace(/\.0+(?=\D|$)/, "");
	}

	showCursor() {
		const dragging = this.input.drag && this.input.drag.far;
		const place = dragging ? null : this.tools.spot || (this.pointer && this.placeAt(this.pointer)) || this.pinned || this.tools.last();
		const error = place && this.surface.find(place[0], place[1]).error;
		const names = this.units.degrees ? ["Lon", "Lat", "H"] : ["E", "N", "H"], units = [this.units.degrees ? "°" : "", this.units.degrees ? "°" : "", this.units.z && " " + this.units.z];

		$("cursor").replaceChildren(...(place || [0, 0, 0]).flatMap((n, axis) => {
			const name = document.createElement("b");
			name.textContent = names[axis];
			return [name, place ? this.axes[axis].text(this.axes[axis].local(n)) + units[axis] : "\u2013"];
		}), error ? " " + this.within(error) : "");
	}
}

// ---- legend ----

function showLegend(page) {
	const {mode, interval, range} = page.scene.state, {units} = page, tick = (part, text, small) => ({part, text, small});
	const title = ["Hillshade", "Elevation" + (units.z ? ", " + units.z : ""), "Slope", "Domains"][mode], lines = [];
	let list = [];

	if (mode === 0)
		lines.push("Light from the north-west, 45° high");
	if (mode === 1) {
		const {list: at, text} = ticks(range[0], range[1], 6), ends = page.surface.box;
		list = at.map(n => tick((n - range[0]) / (range[1] - range[0]), text(n)));
		lines.push(["low", "high"].map((end, i) => page.axes[2].text(page.axes[2].local(ends[end][2] - page.surface.middle[2])) + (i ? "" : " to")).join(" ") +
			(units.z && " " + units.z));
	}
	if (mode === 2)
		list = [0, 10, 20, 30, 45, 60].map(n => tick(n / STEEPEST, n + "°" + (n < STEEPEST ? "" : " and more"), n < STEEPEST ? Math.round(100 * Math.tan(n * Math.PI / 180)) + "\u00a0%" : ""));
	if (mode === 2 && !units.known)
		lines.push("Units are not known: as if x, y and z had the same");
	if (mode === 3)
		lines.push(count(page.mesh.domains.length) + " parts that the mesh was computed in");
	if (interval)
		lines.push(`Contours every ${interval.toFixed(decimalsOf(interval))}${units.z && " " + units.z}, thick every ${(5 * interval).toFixed(decimalsOf(5 * interval))}`);
	$("legend-title").textContent = title;
	$("legend").classList.toggle("plain", mode === 0 || mode === 3);
	$("legend-ramp").style.background = gradient(mode === 2 ? SLOPES : HEIGHTS, "to top");
	$("legend-ticks").replaceChildren(...list.map(t => {
		const span = document.createElement("span"), small = document.createElement("small");
		span.textContent = t.text;
		span.style.bottom = 100 * t.part + "%";
		small.textContent = t.small || "";
		span.append(small);
		return span;
	}));
	$("legend-lines").textContent = lines.join("\n");
}

// ---- what is known of the mesh ----

function showFacts(mesh) {
	const {facts} = mesh, known = facts.comments, system = known["acut-crs"] && known["acut-crs"] !== "unknown" ? known["acut-crs"] : "";
	const number = (n, word) => `${count(n)} ${word}${n === 1 ? "" : "s"}`;

	document.title = facts.name;
	$("title").textContent = $("title").title = facts.name;
	$("facts-line").textContent = number(facts.triangles, "triangle") + (known["acut-trimmed"] ? " \u00b7 a part" : "");
	$("system-line").textContent = $("system-line").title = system || "Coordinate system unknown";
	$("about-open").addEventListener("click", () => $("about").showModal());
	$("about-close").addEventListener("click", () => $("about").close());
	$("theme").addEventListener("click", () => window.acut.page ? window.acut.page.otherTheme() : otherTheme());
}

function showAbout(mesh, page) {
	const {facts} = mesh, known = facts.comments, rows = [["Triangles", count(facts.triangles)], ["Vertices", count(facts.vertices)]];
	const [xy, z] = (known["acut-units"] || "unknown unknown").split(" "), [digest, vertexDigest] = (known["acut-digest"] || "").split(" ");

	if (mesh.domains.length > 1)
		rows.push(["Domains", count(mesh.domains.length)]);
	rows.push(["Coordinate system", known["acut-crs"] || "unknown"], ["Units", xy === z ? xy : `${xy} (x, y), ${z} (heights)`]);
	if (page) {
		const names = page.units.degrees ? ["Longitude", "Latitude", "Heights"] : ["Easting", "Northing", "Heights"];
		names.forEach((name, axis) => rows.push([name, [page.surface.low, page.surface.high].map(end => page.axes[axis].text(page.axes[axis].local(end[axis]))).join(" to ")]));
	}
	for (const [name, key] of [["Origin taken off", "acut-origin"], ["Geoid", "acut-geoid"], ["Heights converted", "acut-z-unit"], ["A part of the mesh", "acut-trimmed"], ["Lattice", "acut-lattice"]])
		if (known[key])
			rows.push([name, known[key]]);
	rows.push(["Digest", digest], ["Digest of vertices", vertexDigest]);
	$("about-list").replaceChildren(...pairs(rows));
}

function otherTheme() {
	const root = document.documentElement, dark = getComputedStyle(root).colorScheme === "dark";

	root.dataset.theme = dark ? "light" : "dark";
}

function fail(text, more) {
	$("head").hidden = !$("title").textContent; // nothing is known
	document.body.classList.remove("loading");
	document.body.classList.add("failed");
	$("message").hidden = false;
	$("message-text").textContent = text;
	$("message-more").textContent = more;
}

// Lets the browser show what there is.
const breathe = () => new Promise(done => setTimeout(done));

async function main() {
	try {
		new DecompressionStream("deflate-raw");
	} catch (error) { // none, or an older one
		throw new Missing("DecompressionStream for deflate-raw");
	}
	await breathe();
	const mesh = await readMesh();

	showFacts(mesh);
	showAbout(mesh, null);
	if (mesh.levels)
		$("about-fine").textContent = "Made by acut. Everything is in this folder, without loss: nothing else is asked for.";
	if (!mesh.facts.triangles) {
		fail("This mesh has no triangles.", mesh.facts.vertices ? `It has ${count(mesh.facts.vertices)} vertices, which are on one line or fewer than three, or whose triangles were left out.` : "It is empty.");
		return null;
	}
	const page = new Page(mesh);
	showAbout(mesh, page);
	document.body.classList.remove("loading");
	$("message").hidden = true;
	return page;
}

// For tests and scripts (docs/design/page.md).
window.acut = {
	ready: main().then(page => {
		window.acut.page = page;
		window.acut.milliseconds = performance.now();
		return Boolean(page);
	}, error => {
		const missing = error instanceof Missing;
		fail(missing ? "This browser cannot show the mesh." : "This page cannot be read.",
			missing ? `It lacks ${error.what}. Current versions of Chrome, Edge, Firefox and Safari have it, unless it is turned off.` : String(error.message || error));
		window.acut.error = String(error);
		if (!missing)
			console.error(error);
		return false;
	}),
	height: (x, y) => window.acut.page.height(x, y),
	pixel: (x, y) => {
		const {axes, surface, camera} = window.acut.page, at = [x, y].map((n, axis) => axes[axis].relative(n - axes[axis].base));
		return camera.project([...at, surface.find(at[0], at[1]).z]);
	},
	place: (px, py) => {
		const {page} = window.acut, place = page.placeAt([px, py]);
		return place && page.coordinates(place);
	},
	// Of a folder: the height at coordinates when the triangles there were read; when all of the picture is; and how far it is off.
	exact: async (x, y) => {
		const {axes, surface} = window.acut.page, at = [x, y].map((n, axis) => axes[axis].relative(n - axes[axis].base));
		return axes[2].base + axes[2].local(await surface.exact(at[0], at[1]));
	},
	settled: () => window.acut.page.surface.settled(),
	profile: () => {
		const {page} = window.acut;
		return page.tools.line.map(p => [p.distance, ...page.coordinates([p.x, p.y, p.z])]);
	},
};
