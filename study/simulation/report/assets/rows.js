// The numbers of a run: unpacked from the page, and as rows for the chart and the table.

async function unpack(text) {
    const binary = atob(text.trim()), bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return JSON.parse(await new Response(stream).text());
}

class Run {
    // Dimensions are what rows differ in: the estimator and the conditions, each with its values and a code per row.
    constructor(data) {
        Object.assign(this, data);
        const labels = data.estimators.map(e => e.label);
        const estimator = { name: "estimator", symbol: "estimator", words: labels, raw: labels, codes: data.estimator };
        const conditions = data.conditions.map(c => ({
            ...c, raw: c.values, words: c.values.map(v => (c.number ? short(v) : v) + c.mark),
        }));
        this.dimensions = [estimator, ...conditions];
        this.dimension = Object.fromEntries(this.dimensions.map(d => [d.name, d]));
        this.measure = Object.fromEntries(data.measures.map(m => [m.name, m]));
    }

    // Rows whose values are among those chosen: a set of codes per dimension, or nothing for all.
    rows(only) {
        const chosen = this.dimensions.filter(d => only[d.name]).map(d => [d.codes, only[d.name]]), found = [];
        for (let i = 0; i < this.trials.length; i++)
            if (chosen.every(([codes, set]) => set.has(codes[i]))) found.push(i);
        return found;
    }

    setting(i) {
        return this.dimensions.slice(1).map(d => `${d.symbol} = ${d.words[d.codes[i]]}`).join(", ");
    }

    label(i) {
        return this.dimension.estimator.words[this.estimator[i]];
    }

    failures(i) {
        const failed = this.trials[i] - this.ok[i];
        if (!failed) return "none failed";
        const kinds = this.failed.filter(f => f.counts[i]).map(f => `${many(f.counts[i])} ${f.words}`);
        return `${many(failed)} not ok (${short(100 * failed / this.trials[i])} %): ${kinds.join("; ")}`;
    }

    // The command that draws the worst trial again; where a run keeps no errors, that of its first trial.
    command(i) {
        return `${this.replay} ${this.worst ? this.worst[i] : `${this.groups[this.group[i]]}/0`}`;
    }

    about(i, measure) {
        const { values, errors } = this.measure[measure];
        const worst = this.worst
            ? (this.worst[i] ? `worst trial, ${short(this.ratio[i])} times the bound` : "")
            : "errors are not kept: any trial can be drawn again, the first is";
        return {
            head: `${this.label(i)}: ${value(values[i], errors[i])}`,
            lines: [
                [this.setting(i), this.fixed].filter(Boolean).join(", "),
                `${this.by} ${this.groups[this.group[i]]}, ${many(this.trials[i])} trials, ${this.failures(i)}`,
            ],
            worst, command: worst && this.command(i),
        };
    }

    // All measures of some rows, as a table for other programs.
    csv(rows) {
        const quote = v => /[",\n]/.test(v) ? `"${String(v).replaceAll('"', '""')}"` : v;
        const number = v => v === null ? "" : v === Infinity ? "inf" : v;
        const head = [
            "run", "group", "estimator", ...this.names(), "planned", "ok",
            ...this.measures.flatMap(m => [m.name, `${m.name}_error`]), "worst_trial",
        ];
        const lines = rows.map(i => [
            this.run, this.groups[this.group[i]], this.estimators[this.estimator[i]].name,
            ...this.dimensions.slice(1).map(d => d.raw[d.codes[i]]), this.trials[i], this.ok[i],
            ...this.measures.flatMap(m => [number(m.values[i]), number(m.errors[i])]), this.worst?.[i] ?? "",
        ].map(quote).join(","));
        return [head.join(","), ...lines, ""].join("\n");
    }

    names() {
        return this.dimensions.slice(1).map(d => d.name);
    }
}

const raised = n => String(n).replace(/[-\d]/g, c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
const many = n => String(n).replace(/\B(?=(\d{3})+$)/g, ",");

function short(v, digits = 3) {
    if (v === null || Number.isNaN(v)) return "–";
    if (!Number.isFinite(v)) return v < 0 ? "−∞" : "∞";
    if (v === 0) return "0";
    const decade = +v.toExponential(digits - 1).split("e")[1];
    return decade >= -3 && decade < 5 ? String(+v.toPrecision(Math.max(digits, decade + 1))).replace("-", "−") : power(v, digits);
}

function power(v, digits = 3) {
    const [mantissa, decade] = v.toExponential(digits - 1).split("e"), front = String(+mantissa).replace("-", "−");
    return front === "1" ? `10${raised(+decade)}` : `${front} × 10${raised(+decade)}`;
}

function value(v, error) {
    return v === null ? "no number" : error === null || error === 0 ? short(v, 4) : `${short(v, 4)} ± ${short(error, 2)}`;
}
