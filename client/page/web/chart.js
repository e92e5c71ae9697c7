// The profile as a chart: distance to the right, heights up, with axes, and the values under the pointer.

class Chart {
	constructor(canvas, text, moved) {
		this.canvas = canvas;
		this.text = text;
		this.moved = moved; // called with a point of the line, or null
		this.line = [];
		canvas.addEventListener("pointermove", e => this.hover(e.offsetX));
		canvas.addEventListener("pointerdown", e => this.hover(e.offsetX));
		canvas.addEventListener("pointerleave", () => this.hover(null));
	}

	// `line`: [{distance, height}], heights with NaN in gaps; `units`: of both; `corners`: the distances of the places that were picked.
	show(line, units, corners) {
		this.line = line;
		this.corners = corners;
		this.units = units;
		this.at = null;
		const heights = line.map(p => p.height).filter(h => !Number.isNaN(h));
		let low = Infinity, high = -Infinity;
		for (const h of heights) {
			low = Math.min(low, h);
			high = Math.max(high, h);
		}
		const room = (high - low) * 0.08 || 0.5;
		this.low = low - room;
		this.high = high + room;
		this.draw();
	}

	layout() {
		const width = this.canvas.clientWidth, height = this.canvas.clientHeight;

		this.frame = {left: 58, right: width - 12, top: 6, bottom: height - 24};
		this.length = this.line.length ? this.line[this.line.length - 1].distance : 0;
	}

	x(distance) {
		return this.frame.left + distance / this.length * (this.frame.right - this.frame.left);
	}

	y(height) {
		return this.frame.bottom - (height - this.low) / (this.high - this.low) * (this.frame.bottom - this.frame.top);
	}

	// How much steeper the chart is than the ground; `scale`: units of length in a unit of height.
	exaggeration(scale) {
		const up = (this.frame.bottom - this.frame.top) / ((this.high - this.low) * scale);

		return up * this.length / (this.frame.right - this.frame.left);
	}

	draw() {
		const ratio = window.devicePixelRatio || 1, canvas = this.canvas, g = canvas.getContext("2d");
		const style = getComputedStyle(document.documentElement), colour = name => style.getPropertyValue(name);

		canvas.width = canvas.clientWidth * ratio;
		canvas.height = canvas.clientHeight * ratio;
		g.setTransform(ratio, 0, 0, ratio, 0, 0);
		this.layout();
		if (!(this.length > 0))
			return;
		g.font = "11px system-ui, sans-serif";
		this.axes(g, colour);
		this.legs(g, colour);
		this.curve(g, colour);
		if (this.at)
			this.cross(g, colour);
	}

	axes(g, colour) {
		const f = this.frame, across = ticks(0, this.length, Math.max(2, (f.right - f.left) / 110)), up = ticks(this.low, this.high, Math.max(2, (f.bottom - f.top) / 34));

		g.lineWidth = 1;
		g.strokeStyle = colour("--border");
		g.fillStyle = colour("--soft");
		g.textAlign = "right";
		g.textBaseline = "middle";
		for (const h of up.list) {
			const y = Math.round(this.y(h)) + 0.5;
			rule(g, f.left, y, f.right, y);
			g.fillText(up.text(h), f.left - 7, y);
		}
		g.textAlign = "center";
		g.textBaseline = "top";
		for (const d of across.list) {
			const x = Math.round(this.x(d)) + 0.5, last = x > f.right - 30;
			rule(g, x, f.top, x, f.bottom + 4);
			g.textAlign = last ? "right" : "center";
			g.fillText(across.text(d) + (d === 0 ? " " + this.units.length : ""), last ? f.right : x, f.bottom + 7);
		}
	}

	// Where the profile has a corner, by the letter that it has on the surface.
	legs(g, colour) {
		g.fillStyle = g.strokeStyle = colour("--mark");
		g.textAlign = "left";
		g.textBaseline = "top";
		g.setLineDash([3, 4]);
		this.corners.forEach((distance, i) => {
			const x = Math.round(this.x(distance)) + 0.5, last = i === this.corners.length - 1;
			if (i && !last)
				rule(g, x, this.frame.top, x, this.frame.bottom);
			g.textAlign = last ? "right" : "left";
			g.fillText(String.fromCharCode(65 + i % 26), last ? x - 4 : x + 4, this.frame.top);
		});
		g.setLineDash([]);
	}

	curve(g, colour) {
		const line = new Path2D(), area = new Path2D(), bottom = this.frame.bottom;
		let start = null, x = 0;

		for (const p of [...this.line, {height: NaN}]) {
			if (Number.isNaN(p.height)) {
				if (start !== null) {
					area.lineTo(x, bottom);
					area.lineTo(start, bottom);
				}
				start = null;
				continue;
			}
			x = this.x(p.distance);
			const y = this.y(p.height);
			if (start === null) {
				area.moveTo(start = x, bottom);
				line.moveTo(x, y);
			}
			area.lineTo(x, y);
			line.lineTo(x, y);
		}
		g.fillStyle = colour("--plot-fill");
		g.fill(area);
		g.strokeStyle = colour("--plot");
		g.lineWidth = 1.8;
		g.lineJoin = "round";
		g.stroke(line);
	}

	cross(g, colour) {
		const x = this.x(this.at.distance), y = this.y(this.at.height);

		g.strokeStyle = colour("--mark");
		g.lineWidth = 1;
		rule(g, x, this.frame.top, x, this.frame.bottom);
		g.beginPath();
		g.arc(x, y, 3.5, 0, 2 * Math.PI);
		g.fillStyle = colour("--mark");
		g.fill();
	}

	hover(px) {
		this.at = px === null || !(this.length > 0) ? null : this.point((px - this.frame.left) / (this.frame.right - this.frame.left) * this.length);
		this.draw();
		this.moved(this.at);
	}

	// Of the line at a distance; null in a gap.
	point(distance) {
		const line = this.line;
		let i = 1;

		if (!(distance >= 0 && distance <= this.length))
			return null;
		while (i < line.length - 1 && line[i].distance < distance)
			i++;
		const a = line[i - 1], b = line[i], part = b.distance > a.distance ? (distance - a.distance) / (b.distance - a.distance) : 0;
		const at = name => a[name] + part * (b[name] - a[name]);
		if (Number.isNaN(at("height")))
			return null;
		return {distance, height: at("height"), x: at("x"), y: at("y"), z: at("z"), rise: (b.height - a.height) / (b.distance - a.distance)};
	}
}

function rule(g, x0, y0, x1, y1) {
	g.beginPath();
	g.moveTo(x0, y0);
	g.lineTo(x1, y1);
	g.stroke();
}
