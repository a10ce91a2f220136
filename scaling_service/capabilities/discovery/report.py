"""``report.html`` of a search: its summary, and the page's views with the models before and after."""

from __future__ import annotations

from scaling_service.capabilities.discovery import text
from scaling_service.capabilities.discovery.document import FILE_NAME, DiscoveryDocument, EffectDocument
from scaling_service.capabilities.discovery.playing import write_discovery_scene
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.playback.scene import INSIDE
from scaling_service.core.text import list_few
from scaling_service.report.onefile import Report, collect_files
from scaling_service.report.summary import Summary
from scaling_service.report.tables import Row, Table

_LINES = 3  # effects that are told in a sentence each (chosen: as many as are read in a minute)
_MOST_LEFT = 12  # places with something left over (chosen); discovery.json has all


def make_report(results: DiscoverResults, document: DiscoveryDocument) -> Report:
    """The search's views with the models in all recordings; ``document`` is ``discovery.json``."""
    files = collect_files(lambda folder: write_discovery_scene(results, folder, INSIDE))
    return Report(
        kind="discovery",
        name=FILE_NAME,
        summary=summarise(document),
        document=document,
        files=files,
        beside=document.files,
        vocabulary={"hidden_in_example": text.describe_hidden(document)},
    )


def summarise(document: DiscoveryDocument) -> Summary:
    """The verdict, what it rests on, what to doubt, the effects, the gap, and what is left."""
    held = f"; held out: {', '.join(document.held_out_trials)}" if document.held_out_trials else ""
    single = [effect for effect in document.effects if not text.is_class_named(effect)]
    why = [_write_sentence(effect) for effect in document.effects[:_LINES]]
    why += [f"And {more} more, in the table."] if (more := len(document.effects) - _LINES) > 0 else []
    why += text.describe_classes(single)
    if document.unexplained:
        left = list_few([place for u in document.unexplained for place in u.where])
        why.append(f"Still beyond what is ordinary, and like no effect that is known: {left}.")
    if document.verdict == "unexplained":
        why.append(f"Described best: {document.unexplained[0].law}.")
    effects = [text.tabulate_effects(document)] if document.effects else []
    hidden = [_tabulate_hidden(document)] if document.hidden else []
    unexplained = [text.tabulate_unexplained(document, _MOST_LEFT)] if document.unexplained else []
    return Summary(
        title=f"What is missing in the model of {document.subject}",
        subtitle=f"Search from the {text.describe_model(document)}. "
        f"Fitted: {', '.join(document.fitted_trials)}{held}",
        headline=document.headline,
        tone=document.tone,
        why=why,
        cautions=[*text.list_cautions(document.effects), *document.notes],
        tables=[*effects, text.tabulate_gaps(document), *unexplained, *hidden],
    )


def _tabulate_hidden(document: DiscoveryDocument) -> Table:
    rows = [Row(said) for said in text.describe_hidden(document)]
    return Table(caption="What had been hidden in this virtual person", columns=["effect"], rows=rows)


def _write_sentence(effect: EffectDocument) -> str:
    return f"{effect.name} ({effect.belief.summary})" if effect.belief else effect.name
