"""One HTML file about a verdict: the answer, one picture, then the rest with a list of it."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from flashtemp.discovery.verdict import Cause, Verdict
from flashtemp.showing import whole_file
from flashtemp.viz import html, verdict_tables
from flashtemp.viz.numbers import needed, number, ratio, spoken

LISTED = 12  # things to look at again
ALARM = 8.0  # ln Bayes factor below which nothing is claimed
LITTLE = 0.005  # share of the root mean square difference that three digits do not show
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
    (
        "Full fit, trace",
        "A full fit simulates the effect; a trace foretells from small changes what it would find.",
    ),
    (
        "Left out",
        "Recordings that no fit has seen, or each condition foretold from the others. A gain there cannot come from "
        "a model that merely bends more.",
    ),
    ("Detectable", "The amplitude that would have stood out by 5 sigma. A smaller one may be there unseen."),
    ("p", "Share of simulated campaigns with nothing but noise in which the same test comes out at least as large."),
    ("chi2/dof", "Mean square of the differences in units of noise: 1 where noise explains everything."),
)
MORE = """
.answer { font-size: 1.25rem; font-weight: 600; } .verdict .says { margin: .5rem 0; }
.key { font-size: .95rem; } .key table { font-size: .9rem; margin: .3rem 0 .8rem; }
td.text { min-width: 11rem; max-width: 30rem; }
@media print { td.text { min-width: 0; } .answer { font-size: 13pt; } .key table { font-size: 8pt; } }
"""


def write(verdict: Verdict, path) -> Path:
    """Write one self-contained HTML file about a verdict, pictures inside; returns its path."""
    path = Path(path)
    with whole_file(path) as fresh:
        fresh.write_text(text(verdict), encoding="utf-8")
    return path


def text(verdict: Verdict) -> str:
    """The whole text of the HTML file."""
    title = f"What the model is missing: {verdict.title}"
    sections = [*_pictures(verdict), *_rest(verdict)] if _whole(verdict) else _rest(verdict)
    first = sections[:1] if _whole(verdict) else []
    more = sections[len(first) :]
    body = [f"<h1>{escape(title)}</h1>", *_answer(verdict), *_laid(first)]
    body.append(html.contents([(mark, head) for mark, head, _ in more]))
    return html.whole(title, [*body, *_laid(more)], MORE)


Section = tuple[str, str, list[str]]  # mark, heading, parts


def _whole(v: Verdict) -> bool:
    """Whether anything was calibrated."""
    return v.kind != "no_verdict" or v.base is not None


def _laid(sections: list[Section]) -> list[str]:
    """Sections one after the other."""
    return [line for mark, head, parts in sections for line in (html.heading(head, mark), *parts)]


# --- the answer -------------------------------------------------------------------------------------
def _answer(v: Verdict) -> list[str]:
    """The first screen: verdict, causes with their parameters, and what they gain."""
    words, grade = _graded(v)
    says = "\n".join(f'<p class="says">{escape(line)}</p>' for line in v.says)
    out = [f'<div class="verdict {grade}">\n<p class="answer">{escape(words)}</p>\n{says}\n</div>']
    if v.kind == "no_verdict":
        known = "Nothing is known yet: no picture is shown." if v.base is None else "What follows is as far as it came."
        return [*out, html.paragraph(f"No cause can be named before it is mended. {known}")]
    out.append('<div class="key">')
    for cause in v.causes:
        out += _cause(cause)
    if v.group:
        out.append(f"<p>Cannot be told apart: <b>{escape(', '.join(spoken(g) for g in v.group))}</b>.</p>")
        some = [r for r in v.rivals if r.effect in v.group]
        rows = [[spoken(r.effect), needed(r), number(r.score), f"{r.distinctness:.2f}"] for r in some]
        out += [html.table(["effect", "would need", "ln Bayes factor", "distinctness"], rows)] if rows else []
    out += [f"<p>{escape(line)}</p>" for line in _gain(v)]
    return [*out, "</div>"]


def _graded(v: Verdict) -> tuple[str, str]:
    """The answer and its colour; nothing is green that hardly changes what is computed."""
    words, grade = ANSWER[v.kind]
    if v.kind == "named" and len(v.causes) > 1:
        words = f"{len(v.causes)} causes are named"
    elif v.kind == "named" and v.causes and v.causes[0].laboratory:
        words = "An error of the laboratory is named"
    if v.kind in ("named", "learned") and _little(v):
        return f"{words}, but it hardly changes what is computed", "near"
    return words, grade


def _little(v: Verdict) -> bool:
    """Whether the gain rounds to nothing: in all that was fitted, in means over frames and in what was left out."""
    if v.base is None or v.extended is None:
        return False
    pairs = [
        (getattr(v.base, key), getattr(v.extended, key))
        for key in ("rmse_K", "mean_map_rmse_K", "near_contact_rmse_K", "held_out_rmse_K")
    ]
    return all(not b - e > LITTLE * b for b, e in pairs if math.isfinite(b) and math.isfinite(e))


def _cause(c: Cause) -> list[str]:
    """An accepted effect in a sentence, and its parameters."""
    words = f"{c.words[:1].upper()}{c.words[1:]}" if c.words else spoken(c.effect)
    line = f"<p><b>{escape(words)}</b> ({escape(spoken(c.effect))}); ln Bayes factor {number(c.ln_bayes)},"
    line += f" distinctness {c.distinctness:.2f}.</p>"
    return [line, *verdict_tables.parameters(c)]


def _gain(v: Verdict) -> list[str]:
    """What the extension changes and improves, in sentences."""
    if v.base is None:
        return []
    b, e = v.base, v.extended
    if e is None:
        line = f"The base leaves {number(b.rmse_K)} K root mean square (chi2/dof {ratio(b.chi2_per_dof)})"
        held = f"; {number(b.held_out_rmse_K)} K on what was left out" if math.isfinite(b.held_out_rmse_K) else ""
        return [f"{line}{held}."]
    line = f"What it gains: the differences, noise included, {_from(b.rmse_K, e.rmse_K)} root mean square"
    line += f" (chi2/dof {ratio(b.chi2_per_dof)} to {ratio(e.chi2_per_dof)})"
    if math.isfinite(b.near_contact_rmse_K) and math.isfinite(e.near_contact_rmse_K):
        line += f", their means over frames near the contact {_from(b.near_contact_rmse_K, e.near_contact_rmse_K)}"
    if math.isfinite(b.held_out_rmse_K) and math.isfinite(e.held_out_rmse_K):
        line += f", on what no fit has seen they {_from(b.held_out_rmse_K, e.held_out_rmse_K)}"
    return [*_changed(v), f"{line}."]


def _from(before: float, after: float) -> str:
    """A change in K; none where it rounds to nothing."""
    if number(before) == number(after):
        return f"stay at {number(before)} K"
    return f"{'shrink' if after < before else 'grow'} from {number(before)} K to {number(after)} K"


def _changed(v: Verdict) -> list[str]:
    """What the extension changes once everything is calibrated again."""
    if not v.gain or not v.gain.get("file"):
        return []
    size = f"{number(v.gain['changed_K'])} K root mean square ({number(100 * v.gain['share'])} % of its rise)"
    line = (
        f"What it changes: with everything calibrated again, {v.gain['file']} by {size}, more than any other recording"
    )
    pull = v.gain.get("friction", 0.0)
    return [f"{line}; the friction of a trace by {number(100 * pull)} %." if pull >= 1e-3 else f"{line}."]


# --- sections ---------------------------------------------------------------------------------------
def _pictures(v: Verdict) -> list[Section]:
    """Sections with a picture or a word why there is none, and tables; a law that was learned first."""
    from flashtemp.viz import discovery, in_words, learned_law, verdict_parts

    figures = discovery.figures(v)
    tables = {
        "what_is_wrong": _chosen, "not_noise": verdict_tables.noise, "else": verdict_tables.rivals,
        "gained": verdict_tables.before_after,
    }  # fmt: skip
    out: list[Section] = learned_law.section(v, figures)
    for count, name in enumerate(discovery.CAPTIONS, 1):
        parts = [html.paragraph(discovery.ABSENT[name])]
        if name in figures:
            parts = [html.figure(figures[name], in_words.alt(v, name), discovery.CAPTIONS[name])]
        parts += tables[name](v) if name in tables else []
        out.append((name.replace("_", "-"), f"{count}. {verdict_parts.head(v, name)}", parts))
    return out


def _chosen(v: Verdict) -> list[str]:
    """Which conditions are drawn."""
    from flashtemp.viz import verdict_parts

    return [html.paragraph(words, "small") for words in [verdict_parts.choice(v)] if words]


def _rest(v: Verdict) -> list[Section]:
    """What to do next, and what the verdict rests on."""
    whole = _whole(v)
    warned = (
        ["<ul>", *(f"<li>{escape(w)}</li>" for w in v.warnings), "</ul>"] if v.warnings else [html.paragraph("None.")]
    )
    spent = [html.paragraph(f"Computed in {number(v.seconds)} s.", "small")] if v.seconds else []
    some: list[Section] = [
        ("again", "What to look at again", _look(v)),
        ("next", "What to measure next", [html.paragraph(v.next_experiment)] if v.next_experiment else []),
        ("warnings", "Warnings", warned),
        ("checked", "What was checked before the answer was given", verdict_tables.gates(v)),
        ("known", "What was known, and what calibration made of it", verdict_tables.known(v) if whole else []),
        ("unseen", "Smallest amplitudes that would have been seen", verdict_tables.unseen(v) if whole else []),
        ("certificate", "Certificate of convergence", [*verdict_tables.certificate(v), *spent]),
        ("reading", "How to read this", [html.terms(READING)] if whole else []),
    ]
    return [section for section in some if section[2]]


def _look(v: Verdict) -> list[str]:
    """What to look at again in the laboratory and in the case, what would explain most first."""
    if not v.checklist:
        return []
    rows = [[c.sort, c.words, number(c.ln_bayes)] for c in v.checklist[:LISTED]]
    return [html.table(["", "if it were so that", "it would explain (ln Bayes factor)"], rows)]
