"""One HTML file about a verdict: the answer first, six pictures and how to read them, then what it rests on."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from flashtemp.discovery.verdict import Cause, Rival, Verdict
from flashtemp.showing import whole_file
from flashtemp.viz import html

LISTED = 12  # things to look at again
ALARM = 8.0  # ln Bayes factor below which nothing is claimed
ANSWER = {
    "named": ("The cause is named", "good"),
    "learned": ("A law was learned that is not in the catalogue", "good"),
    "held_key": ("A key of the case is not what it was held to be", "near"),
    "weak": ("A cause is likely, but the evidence is weak", "near"),
    "group": ("Something is missing; these data cannot tell which of several causes it is", "near"),
    "none_needed": ("No extension is needed", "good"),
    "unexplained": ("Something is missing, and nothing in the catalogue explains it", "bad"),
    "no_verdict": ("No verdict: the calibration cannot be relied on", "bad"),
}
READING = (
    ("Base", "The model as it was believed, its uncertain parameters calibrated to these data."),
    ("Extended", "The base with the accepted causes, calibrated again."),
    (
        "ln Bayes factor",
        "How much more probable the data are with the effect than without it, as a natural logarithm, after "
        f"everything that calibration could absorb has been taken away. {ALARM:g} means about 3000 times; below that "
        "nothing is claimed.",
    ),
    ("95 % interval", "Range that holds the true value in 19 of 20 such campaigns, if the model is right otherwise."),
    ("Distinctness", "How far the trace of an effect differs from all others: 0 the same, 1 nothing in common."),
    ("Held out", "Recordings that no fit has seen. A gain there cannot come from a model that merely bends more."),
    ("Detectable", "The amplitude that would have stood out by 5 sigma. A smaller one may be there unseen."),
    ("p", "Share of simulated campaigns with nothing but noise in which the same test comes out at least as large."),
)
MORE = """
.answer { font-size: 1.25rem; font-weight: 600; } .verdict .says { margin: .5rem 0; }
.key { font-size: .95rem; } .key table { font-size: .9rem; margin: .3rem 0 .8rem; }
td.text { min-width: 11rem; max-width: 30rem; }
@media print { td.text { min-width: 0; } .answer { font-size: 13pt; } .key table { font-size: 8pt; } }
"""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def write(verdict: Verdict, path) -> Path:
    """Write one self-contained HTML file about a verdict, pictures inside; returns its path."""
    path = Path(path)
    with whole_file(path) as fresh:
        fresh.write_text(text(verdict), encoding="utf-8")
    return path


def text(verdict: Verdict) -> str:
    """The whole text of the HTML file."""
    title = f"What the model is missing: {verdict.title}"
    whole = verdict.kind != "no_verdict" or verdict.base is not None
    body = [f"<h1>{escape(title)}</h1>", *_answer(verdict)]
    if whole:
        body += [*_look(verdict), *_pictures(verdict), *_known(verdict), *_unseen(verdict)]
    body += [*_advice(verdict), *_certificate(verdict)]
    if whole:
        body += ["<h2>How to read this</h2>", html.terms(READING)]
    return html.whole(title, body, MORE)


# --- the answer -------------------------------------------------------------------------------------
def _answer(v: Verdict) -> list[str]:
    """The first screen: verdict, causes with their parameters, and what they gain."""
    words, grade = ANSWER[v.kind]
    if v.kind == "named" and len(v.causes) > 1:
        words = f"{len(v.causes)} causes are named"
    elif v.kind == "named" and v.causes and v.causes[0].laboratory:
        words = "An error of the laboratory is named"
    says = "\n".join(f'<p class="says">{escape(line)}</p>' for line in v.says)
    out = [f'<div class="verdict {grade}">\n<p class="answer">{escape(words)}</p>\n{says}\n</div>']
    if v.kind == "no_verdict":
        known = "Nothing is known yet: no picture is shown." if v.base is None else "What follows is as far as it came."
        return [*out, html.paragraph(f"No cause can be named before it is mended. {known}")]
    out.append('<div class="key">')
    for cause in v.causes:
        out += _cause(cause)
    if v.group:
        out.append(f"<p>Cannot be told apart: <b>{escape(', '.join(_name(g) for g in v.group))}</b>.</p>")
        some = [r for r in v.rivals if r.effect in v.group]
        rows = [[_name(r.effect), _need(r), _number(r.score), f"{r.distinctness:.2f}"] for r in some]
        out += [html.table(["effect", "would need", "ln Bayes factor", "distinctness"], rows)] if rows else []
    out += [f"<p>{escape(line)}</p>" for line in _gain(v)]
    return [*out, "</div>"]


def _cause(c: Cause) -> list[str]:
    """An accepted effect in a sentence, and its parameters."""
    words = f"{c.words[:1].upper()}{c.words[1:]}" if c.words else _name(c.effect)
    line = f"<p><b>{escape(words)}</b> ({escape(_name(c.effect))}); ln Bayes factor {_number(c.ln_bayes)},"
    line += f" distinctness {c.distinctness:.2f}.</p>"
    rows = [
        [
            p.name,
            _pm(p.value, p.stderr, p.unit),
            f"{_number(p.ci95[0])} to {_number(p.ci95[1])}{_unit(p.unit)}" if p.ci95[1] > p.ci95[0] else "–",
            "yes: its interval means little" if p.bound else "no",
        ]
        for p in c.parameters
    ]
    head = ["parameter", "value ± standard error", "95 % interval", "at its bound"]
    return [line, *([html.table(head, rows)] if rows else [])]


def _gain(v: Verdict) -> list[str]:
    """What the extension improves, in sentences."""
    if v.base is None:
        return []
    b, e = v.base, v.extended
    if e is None:
        line = f"The base leaves {_number(b.rmse_K)} K root mean square (chi2/dof {_ratio(b.chi2_per_dof)})"
        held = f"; {_number(b.held_out_rmse_K)} K on what was held out" if math.isfinite(b.held_out_rmse_K) else ""
        return [f"{line}{held}."]
    line = f"What it gains: the differences shrink from {_number(b.rmse_K)} K to {_number(e.rmse_K)} K root mean square"
    line += f" (chi2/dof {_ratio(b.chi2_per_dof)} to {_ratio(e.chi2_per_dof)})"
    if math.isfinite(b.held_out_rmse_K) and math.isfinite(e.held_out_rmse_K):
        line += f", on what no fit has seen from {_number(b.held_out_rmse_K)} K to {_number(e.held_out_rmse_K)} K"
    return [f"{line}."]


def _look(v: Verdict) -> list[str]:
    """What to look at again in the laboratory and in the case, what would explain most first."""
    if not v.checklist:
        return []
    rows = [[c.sort, c.words, _number(c.ln_bayes)] for c in v.checklist[:LISTED]]
    head = ["", "if it were so that", "it would explain (ln Bayes factor)"]
    return ["<h2>What to look at again</h2>", html.table(head, rows)]


# --- pictures ---------------------------------------------------------------------------------------
def _pictures(v: Verdict) -> list[str]:
    """Six sections, each with its picture or a word why there is none, and its tables."""
    from flashtemp.viz import discovery, learned_law, verdict_parts

    figures = discovery.figures(v)
    tables = {"what_is_wrong": _chosen, "not_noise": _tests, "else": _rivals, "gained": _before_after}
    out = learned_law.section(v, figures)
    for number, name in enumerate(discovery.CAPTIONS, 1):
        head = verdict_parts.head(v, name)
        out.append(f"<h2>{number}. {escape(head)}</h2>")
        drawn = name in figures
        out.append(
            html.figure(figures[name], head, discovery.CAPTIONS[name])
            if drawn
            else html.paragraph(discovery.ABSENT[name])
        )
        out += tables[name](v) if name in tables else []
    return out


def _chosen(v: Verdict) -> list[str]:
    """Which conditions are drawn."""
    from flashtemp.viz import verdict_parts

    return [html.paragraph(words, "small") for words in [verdict_parts.choice(v)] if words]


def _tests(v: Verdict) -> list[str]:
    """Tests for structure, before and after the extension."""
    if not v.tests:
        return [html.paragraph("No tests for structure were run.", "small")]
    rows = [[t.name, t.where, t.stage, _number(t.statistic), _chance(t.p)] for t in v.tests]
    return [html.table(["test for structure", "recording", "extension", "statistic", "p, simulated"], rows)]


def _rivals(v: Verdict) -> list[str]:
    """Every candidate that was not accepted, best first."""
    taken = {c.effect for c in v.causes}
    some = sorted((r for r in v.rivals if r.effect not in taken), key=lambda r: -r.score)
    head = ["candidate", "would need", "ln Bayes factor", "by", "accepted causes keep", "distinctness", "why not"]
    rows = [
        [
            _name(r.effect), _need(r), *_scored(r),
            "–" if r.left is None else _number(r.left), f"{r.distinctness:.2f}", r.reason,
        ]
        for r in some
    ]  # fmt: skip
    return [html.table(head, rows) if rows else html.paragraph("No other candidate was tried.", "small")]


def _before_after(v: Verdict) -> list[str]:
    """Numbers of the base and of the extended model, and the parameters that moved."""
    out = []
    if v.base is not None:
        told = (("rmse_K", "root mean square difference (K)"), ("mean_map_rmse_K", "of means over frames (K)"),
                ("near_contact_rmse_K", "near the contact (K)"), ("chi2_per_dof", "chi2/dof (–)"),
                ("held_out_rmse_K", "held out (K)"), ("held_out_z", "held out, in sigma (–)"))  # fmt: skip
        models = [m for m in (v.base, v.extended) if m is not None]
        rows = [
            [words, *((_number if key.endswith("K") else _ratio)(getattr(m, key)) for m in models)]
            for key, words in told
        ]
        rows = [r for r in rows if any(cell != "–" for cell in r[1:])]
        out.append(html.table(["", "base", "extended"][: 1 + len(models)], rows))
    for c in v.causes:
        gain = f"{_name(c.effect)}: {_number(c.held_out_gain)} nats gained per reading left out"
        out.append(html.paragraph(f"{gain}; chi2 lower by {_number(c.delta_chi2)}.", "small"))
    if v.shifts:
        rows = [[n, _number(b), _number(a), _number(s)] for n, b, a, s in v.shifts]
        out.append(html.table(["calibrated parameter", "base", "extended", "standard error"], rows))
    return out


# --- what it rests on -------------------------------------------------------------------------------
def _known(v: Verdict) -> list[str]:
    """What was taken as known beforehand, and what calibration made of it."""
    out = ["<h2>What was assumed known</h2>"]
    if v.assumed:
        out.append(html.table(["quantity", "prior"], [[n, _number(s)] for n, s in v.assumed.items()]))
    else:
        out.append(html.paragraph("No prior knowledge was stated with this verdict."))
    if v.nuisance:
        rows = [[p.name, _pm(p.value, p.stderr, p.unit), f"{p.pull:+.1f}".replace("-", "−")] for p in v.nuisance]
        out.append(html.table(["calibrated", "value ± standard error", "pull in sigma of what was known"], rows))
    return out


def _unseen(v: Verdict) -> list[str]:
    """The smallest amplitudes that would have been seen."""
    some = [r for r in v.rivals if math.isfinite(r.detectable)]
    head = "<h2>Smallest amplitudes that would have been seen</h2>"
    if not some:
        return [head, html.paragraph("They were not computed.")]
    rows = [
        [_name(r.effect), r.parameter or "amplitude", _detectable(r), f"{_number(100 * r.raw_share)} %"] for r in some
    ]
    return [
        head,
        html.paragraph("Smaller ones may be there: these data would not show them by 5 sigma."),
        html.table(["effect", "parameter", "detectable at 5 sigma", "share of its signal that is left"], rows),
    ]


def _advice(v: Verdict) -> list[str]:
    """What to measure next, where anything was proposed, and what to beware of."""
    after = ["<h2>What to measure next</h2>", html.paragraph(v.next_experiment)] if v.next_experiment else []
    items = (
        ["<ul>", *(f"<li>{escape(w)}</li>" for w in v.warnings), "</ul>"] if v.warnings else [html.paragraph("None.")]
    )
    return [*after, "<h2>Warnings</h2>", *items]


def _certificate(v: Verdict) -> list[str]:
    """How far the calibration is to be trusted."""
    out = ["<h2>Certificate of convergence</h2>"]
    if v.certificate:
        rows = [[_name(k), _plain(value)] for k, value in _flat(v.certificate)]
        out.append(html.table(["calibration", ""], rows))
    else:
        out.append(html.paragraph("None was issued."))
    if v.gates:
        rows = [[_name(k), _number(x), _number(most), "no" if x > most else "yes"] for k, (x, most) in v.gates.items()]
        out.append(html.table(["checked for adequacy", "value", "limit", "within"], rows))
    if v.seconds:
        out.append(html.paragraph(f"Computed in {_number(v.seconds)} s.", "small"))
    return out


# --- words and numbers ------------------------------------------------------------------------------
def _name(key: str) -> str:
    return key.replace("_", " ")


def _unit(unit: str) -> str:
    if unit in ("", "1"):
        return ""
    return " " + unit.replace("m2", "m²").replace("m3", "m³").replace("degC", "°C")


def _number(value: float) -> str:
    """Three digits, powers of ten raised, a dash for what is not known.

    >>> _number(1.2345e-10), _number(-0.5), _number(3140.0), _number(float("nan"))
    ('1.23 × 10⁻¹⁰', '−0.5', '3140', '–')
    """
    value = float(value)
    if not math.isfinite(value):
        return "–" if math.isnan(value) else f"{'−' if value < 0 else ''}∞"
    if value and not 1e-3 <= abs(value) < 1e6:
        digits, power = f"{value:.2e}".split("e")
        digits = digits.rstrip("0").rstrip(".")
        return f"{digits} × 10{str(int(power)).translate(RAISED)}".replace("-", "−")
    text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return text.replace("-", "−")


def _ratio(value: float) -> str:
    return f"{value:.2f}" if 0.01 <= value < 10 else _number(value)


def _pm(value: float, error: float, unit: str) -> str:
    """A value with its standard error, to two digits of the error.

    >>> _pm(1.7243, 0.0512, "1"), _pm(2.1e-6, 1.5e-7, "m")
    ('1.724 ± 0.051', '(2.10 ± 0.15) × 10⁻⁶ m')
    """
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return _number(value) + _unit(unit)
    size = max(abs(value), error)
    power = math.floor(math.log10(size)) if not 1e-3 <= size < 1e6 else 0
    value, error = value / 10.0**power, error / 10.0**power
    places = min(max(0, 1 - math.floor(math.log10(error))), 6)
    text = f"{value:.{places}f} ± {error:.{places}f}".replace("-", "−")
    return (f"({text}) × 10{str(power).translate(RAISED)}" if power else text) + _unit(unit)


def _need(r: Rival) -> str:
    if not r.amplitude and not r.stderr:
        return "–"
    return f"{r.parameter} = {_pm(r.amplitude, r.stderr, r.unit)}".removeprefix(" = ")


def _scored(r: Rival) -> tuple[str, str]:
    """The ln Bayes factor and what it rests on."""
    if r.refitted or r.stderr > 0:
        return _number(r.score), "full fit" if r.refitted else "trace"
    return "–", "not tried"


def _detectable(r: Rival) -> str:
    return _number(r.detectable) + _unit(r.unit) if math.isfinite(r.detectable) else "not in these data"


def _chance(p: float) -> str:
    return "below 0.001" if p < 1e-3 else _number(p)


def _flat(some: dict, before: str = "") -> list[tuple[str, object]]:
    """Entries of dictionaries in dictionaries, one after the other."""
    own = [(f"{before}{k}", v) for k, v in some.items()]
    return [pair for k, v in own for pair in (_flat(v, f"{k}: ") if isinstance(v, dict) else [(k, v)])]


def _plain(value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return _number(value)
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(v) for v in value)
    return str(value)
