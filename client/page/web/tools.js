// Distance and profile: places that are clicked, and what follows from them.

class Tools {
	constructor(page) {
		this.page = page;
		this.name = null; // "distance" or "profile"
		this.corners = {distance: [], profile: []};
		this.line = []; // of the profile: {distance, height, x, y, z}; x, y, z are places
		this.spot = null;
		this.chart = new Chart($("plot"), $("plot-text"), point => this.pointed(point));
	}

	// Begins with a tool, or ends with it.
	choose(name) {
		this.name = name === this.name ? null : name;
		for (const tool of ["distance", "profile"])
			$(tool).setAttribute("aria-pressed", this.name === tool);
		$("scene").classList.toggle("picking", Boolean(this.name));
		this.page.panel(false);
		this.page.pinned = null;
		if (this.name === "distance")
			this.close("profile");
		if (this.name === "profile")
			this.close("distance");
		this.changed();
	}

	close(name) {
		this.corners[name] = [];
		if (this.name === name)
			this.choose(name);
		else
			this.changed();
	}

	click(place) {
		if (!this.name || !place)
			return false;
		const last = this.last();
		if (last && last.every((n, axis) => n === place[axis]))
			return true; // a double click
		this.corners[this.name].push(place);
		this.page.exactly(place);
		this.changed();
		return true;
	}

	// The corner that was picked last with the tool that is on, or null.
	last() {
		return this.name && this.corners[this.name].at(-1) || null;
	}

	undo() {
		const corners = this.corners[this.name || (this.corners.profile.length ? "profile" : "distance")];

		corners.pop();
		this.changed();
	}

	changed() {
		const {distance, profile} = this.corners;

		this.line = profile.length > 1 ? this.profileOf(profile) : [];
		this.spot = null;
		$("measure").hidden = this.name !== "distance" && distance.length < 2;
		if (!$("measure").hidden)
			this.showDistance(distance);
		const chart = this.line.length > 1;
		$("chart").hidden = !chart;
		document.body.classList.toggle("charting", chart);
		if (chart)
			this.showProfile();
		this.reveal(chart ? $("chart") : $("measure"), chart ? profile : distance);
		this.hint();
		this.page.update(false);
	}

	// What was picked goes up if a card at the bottom lies over it.
	reveal(card, corners) {
		const {camera} = this.page, top = card.hidden ? 0 : card.getBoundingClientRect().top;
		const lowest = Math.max(0, ...corners.map(c => (camera.project(c) || [0, 0])[1])), most = top - 30;

		if (top > camera.height / 3 && lowest > most && lowest < camera.height) {
			camera.pan(0, most - lowest);
			this.page.update();
		}
	}

	hint() {
		const n = this.name ? this.corners[this.name].length : 0;
		const text = {
			distance: ["Pick the first place", "Pick the next place"], profile: ["Pick where the profile begins", "Pick where it goes on, or ends"],
		}[this.name];

		$("hint").hidden = !text || n > 1;
		$("hint").textContent = text ? text[Math.min(n, 1)] : "";
	}

	// For the overlay.
	paths() {
		const {distance, profile} = this.corners, list = [];

		if (distance.length)
			list.push({places: distance, corners: distance});
		if (profile.length) {
			const every = Math.ceil(this.line.length / 4000) || 1;
			const places = this.line.filter((p, i) => i % every === 0 || Number.isNaN(p.z) || i === this.line.length - 1);
			list.push({places: places.map(p => Number.isNaN(p.z) ? null : [p.x, p.y, p.z]), corners: profile});
		}
		return list;
	}

	// ---- distance ----

	// Between two places: east, north and up, in units of length.
	between(a, b) {
		return [0, 1, 2].map(axis => (b[axis] - a[axis]) * this.page.step[axis]);
	}

	showDistance(corners) {
		const {units} = this.page, list = $("measure-list"), about = units.degrees ? "about " : "";
		let plan = 0, slope = 0;

		for (let i = 1; i < corners.length; i++) {
			const [e, n, h] = this.between(corners[i - 1], corners[i]);
			plan += Math.hypot(e, n);
			slope += Math.hypot(e, n, h);
		}
		const rows = [["In plan", about + lengthText(plan, units.length)]];
		if (corners.length > 1) {
			const first = corners[0], last = corners[corners.length - 1], rise = last[2] - first[2];
			const [e, n] = this.between(corners[corners.length - 2], last);
			rows.push(["On the slope", about + lengthText(slope, units.length)]);
			rows.push(["Rise", (rise < 0 ? "\u2212" : "+") + lengthText(Math.abs(rise) * this.page.axes[2].step, units.z)]);
			rows.push(["Gradient", plan > 0 ? (100 * rise * this.page.step[2] / plan).toFixed(2).replace("-", "\u2212") + "\u00a0%" : "\u2013"]);
			rows.push([corners.length > 2 ? "Direction of the last leg" : "Direction", ((Math.atan2(e, n) * 180 / Math.PI + 360) % 360).toFixed(1) + "°"]);
		}
		list.replaceChildren(...pairs(rows));
		$("measure-undo").disabled = !corners.length;
	}

	// ---- profile ----

	// The exact section along all legs.
	profileOf(corners) {
		const {surface, step, axes} = this.page, line = [];
		let before = 0;

		this.legs = [0];
		this.error = 0;
		for (let i = 1; i < corners.length; i++) {
			const [a, b] = [corners[i - 1], corners[i]], length = Math.hypot((b[0] - a[0]) * step[0], (b[1] - a[1]) * step[1]);
			const section = surface.section(a[0], a[1], b[0], b[1]);
			this.error = Math.max(this.error, section.error);
			for (const p of section.line) {
				const x = a[0] + p.t * (b[0] - a[0]), y = a[1] + p.t * (b[1] - a[1]);
				line.push({distance: before + p.t * length, height: axes[2].base + axes[2].local(p.z), x, y, z: p.z});
			}
			this.legs.push(before += length);
		}
		return line;
	}

	showProfile() {
		const {units, axes} = this.page;
		let climb = 0, fall = 0, low = Infinity, high = -Infinity;

		this.line.forEach((p, i) => {
			const rise = i ? p.height - this.line[i - 1].height : 0;
			climb += Math.max(0, rise) || 0;
			fall += Math.max(0, -rise) || 0;
			low = p.height < low ? p.height : low;
			high = p.height > high ? p.height : high;
		});
		this.chart.show(this.line, {length: units.length, height: units.z}, this.legs);
		const text = n => n.toFixed(Math.min(2, axes[2].decimals)), unit = units.z && "\u00a0" + units.z;
		$("chart-facts").textContent = `${units.degrees ? "about " : ""}${lengthText(this.chart.length, units.length)} long \u00b7 heights ${text(low)} to ${text(high)}${unit} \u00b7 ` +
			`up ${text(climb)}, down ${text(fall)}${unit} \u00b7 heights \u00d7 ${this.chart.exaggeration(this.page.step[2] / axes[2].step).toPrecision(2)}` +
			(this.error ? ` \u00b7 ${this.page.within(this.error)}` : "");
		this.pointed(null);
	}

	// A place of the chart.
	pointed(point) {
		const {units, axes, step} = this.page;

		this.spot = point && [point.x, point.y, point.z];
		$("plot-text").textContent = point ? `${lengthText(point.distance, units.length)} \u00b7 ${axes[2].text(axes[2].local(point.z))}${units.z && "\u00a0" + units.z} \u00b7 ` +
			`${(100 * point.rise * step[2] / axes[2].step).toFixed(1)}\u00a0%` : "";
		this.page.update(false);
	}

	csv() {
		const {axes, units} = this.page, digits = axis => Math.min(axes[axis].decimals + 3, 12);
		const text = (axis, n) => (axes[axis].base + axes[axis].local(n)).toFixed(digits(axis));
		const names = units.degrees ? "longitude,latitude" : "easting,northing";
		const rows = this.line.map(p => [p.distance.toFixed(4), text(0, p.x), text(1, p.y), Number.isNaN(p.z) ? "" : text(2, p.z)].join(","));

		return `distance,${names},height\n${rows.join("\n")}\n`;
	}

	async copy() {
		const button = $("chart-copy");

		button.textContent = await copyText(this.csv()) ? "Copied" : "Not possible";
		setTimeout(() => button.textContent = "Copy CSV", 1500);
	}

	save() {
		const link = document.createElement("a");

		link.href = URL.createObjectURL(new Blob([this.csv()], {type: "text/csv"}));
		link.download = this.page.mesh.facts.name + "-profile.csv";
		link.click();
		setTimeout(() => URL.revokeObjectURL(link.href), 10000);
	}
}

async function copyText(text) {
	try {
		await navigator.clipboard.writeText(text);
		return true;
	} catch (error) { // not from a file in some browsers
		const area = document.createElement("textarea");
		area.value = text;
		document.body.append(area);
		area.select();
		const done = document.execCommand("copy");
		area.remove();
		return done;
	}
}

// Rows of a list of names and values.
function pairs(rows) {
	return rows.flatMap(([name, value]) => {
		const dt = document.createElement("dt"), dd = document.createElement("dd");

		dt.textContent = name;
		dd.textContent = value;
		return [dt, dd];
	});
}
