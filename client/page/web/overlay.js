// What is drawn over the surface: lines that were measured, their corners, the place under the pointer.

const SVG = "http://www.w3.org/2000/svg";

class Overlay {
	constructor(svg) {
		this.svg = svg;
	}

	// `paths`: [{places, corners}], of which `places` is the line, null in gaps, and `corners` is what was clicked; `spot`: one place, or
	// null.
	draw(camera, paths, spot) {
		const shapes = paths.flatMap(path => this.path(camera, path)), p = spot && camera.project(spot);

		if (p)
			shapes.push(...this.twice("circle", {cx: p[0], cy: p[1], r: 7, fill: "none"}));
		if (shapes.length || this.svg.firstChild)
			this.svg.replaceChildren(...shapes);
	}

	path(camera, path) {
		let d = "", pen = "M";

		for (const place of path.places) {
			const p = place && camera.project(place);
			d += p ? pen + p[0].toFixed(1) + " " + p[1].toFixed(1) : "";
			pen = p ? "L" : "M";
		}
		return [...this.twice("path", {d, fill: "none"}), ...path.corners.flatMap((corner, i) => this.corner(camera.project(corner), i))];
	}

	corner(p, i) {
		if (!p)
			return [];
		const text = this.shape("text", {x: p[0] + 8, y: p[1] - 7});
		text.textContent = String.fromCharCode(65 + i % 26);
		return [this.shape("circle", {cx: p[0], cy: p[1], r: 5, class: "corner"}), text];
	}

	// On all colours: with a border.
	twice(name, attributes) {
		return ["halo", "line"].map(style => this.shape(name, {...attributes, class: style}));
	}

	shape(name, attributes) {
		const shape = document.createElementNS(SVG, name);

		for (const [key, value] of Object.entries(attributes))
			shape.setAttribute(key, value);
		return shape;
	}
}
