// Coordinates, units, and numbers as text.

// One axis: coordinate = (number * a + b) / q, with whole numbers of any size. Pages calculate with local coordinates: doubles
// relative to a whole coordinate near the mesh, so that they keep their last digit. The part of it that is not local is added at
// the very end.
class Axis {
	constructor(fact, middle) {
		const a = BigInt(fact.a), b = BigInt(fact.b), q = BigInt(fact.q);

		this.decimals = fact.decimals;
		this.base = Math.round(Number(BigInt(middle) * a + b) / Number(q));
		// local = ((number - middle) * a + rest) / q, where the rest is a small number without an error
		this.a = Number(a);
		this.q = Number(q);
		this.rest = Number(BigInt(middle) * a + b - BigInt(this.base) * q);
		this.step = this.a / this.q;
		// Shown are as many as a step has; a converted one has many, or no end of them, and then those that tell steps apart.
		const apart = decimalsOf(this.step);
		this.shown = this.decimals > apart + 2 ? apart : this.decimals;
	}

	// Of a lattice number relative to the middle one, or of a place between two.
	local(relative) {
		return (relative * this.a + this.rest) / this.q;
	}

	relative(local) {
		return (local * this.q - this.rest) / this.a;
	}

	text(local) {
		return group((this.base + local).toFixed(Math.min(this.shown, 9)));
	}
}

// "1234567.89" with thin spaces between the thousands.
function group(text) {
	const [whole, part] = text.split(".");

	return whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") + (part === undefined ? "" : "." + part);
}

const count = n => group(String(n));

const METRES = {"metre": 1, "foot": 0.3048, "us-survey-foot": 1200 / 3937, "degree": 111320};
const SHORT = {"metre": "m", "foot": "ft", "us-survey-foot": "ftUS", "degree": "°"};

// What --origin took off the coordinates.
function originOf(facts) {
	const words = (facts.comments["acut-origin"] || "0 0 0").split(" ");

	return words.map(Number);
}

// What a step of x, y and z is in the scene, where slopes and lengths are measured. Its unit is that of x and y; of degrees it is
// the metre, about: a degree of longitude is as long as in the middle of the mesh. Units that are not known count as equal.
class Units {
	constructor(words, latitude) {
		const [xy, z] = words, metres = METRES[xy] || 0;

		this.degrees = xy === "degree";
		this.xy = SHORT[xy] || "";
		this.z = SHORT[z] || "";
		this.length = this.degrees ? "m" : this.xy;
		this.scale = this.degrees ? [metres * Math.cos(latitude * Math.PI / 180), metres] : [1, 1];
		this.scale.push(metres && METRES[z] ? METRES[z] / (this.degrees ? 1 : metres) : 1);
		this.known = Boolean(metres && METRES[z]);
	}
}

// 1, 2 or 5 times a power of ten, at least n.
function nice(n) {
	const power = 10 ** Math.floor(Math.log10(n)), part = n / power;

	return power * (part <= 1.000001 ? 1 : part <= 2.000001 ? 2 : part <= 5.000001 ? 5 : 10);
}

// Decimals that show multiples of a step.
const decimalsOf = step => Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));

// Multiples of a nice step between low and high, about `most` of them.
function ticks(low, high, most) {
	const step = nice((high - low) / most || 1), list = [];

	for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++)
		list.push(i * step);
	return {step, list, text: n => group((Math.abs(n) < step / 2 ? 0 : n).toFixed(decimalsOf(step)))};
}

// A length in `unit`, with as many digits as one reads.
function lengthText(n, unit) {
	if (unit === "m" && n >= 10000)
		return (n / 1000).toFixed(n < 100000 ? 2 : 1) + "\u00a0km";
	return group(n.toFixed(n < 10 ? 3 : n < 10000 ? 2 : 1)) + (unit && "\u00a0" + unit);
}
