"""Reports and labels of operators, translated into the interface's language."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

from ..core.base.errors import KirikoError, one_line
from ..core.base.messages import CONTEXT, Message, as_message
from ..core.blender.data.stored_records import take_reports

translations = bpy.app.translations
Translate = Callable[[str], str]  # translates a template


def interface(text: str) -> str:
    """A text translated like labels.

    Blender's own terms, such as a shader input, use Blender's translation.
    """
    own = str(translations.pgettext_iface(text, CONTEXT))
    return str(translations.pgettext_iface(text)) if own == text else own


def reports(text: str) -> str:
    """A text translated like reports."""
    own = str(translations.pgettext_rpt(text, CONTEXT))
    return str(translations.pgettext_iface(text)) if own == text else own


def in_words(text: str, translate: Translate | None = None) -> str:
    """A sentence as panels show it, or by another translation.

    A message is translated by its template; a plain text is a template without values.
    """
    translate = translate or interface
    return text.sentence(translate) if isinstance(text, Message) else translate(text)


def report(operator: bpy.types.Operator, level: str, text: str) -> None:
    """Report a sentence in one line, as "INFO", "WARNING" or "ERROR"."""
    operator.report({level}, one_line(in_words(text, reports)))


def sentence(
    error: BaseException, label: str, stays: str = "", translate: Translate | None = None
) -> str:
    """Report on an expected or unexpected error of the work called `label`.

    Nothing of the work is kept except what the sentence names. The traceback of an unexpected error
    goes to the console.

    translate : `str` if a script reads it, as in a terminal
    """
    translate = translate or reports
    label, stays = as_message(label), stays and as_message(stays)
    state = (
        Message("{thing} was kept (Undo removes it)", thing=stays)
        if stays
        else Message("the scene is unchanged")
    )
    if isinstance(error, KirikoError):
        return one_line(in_words(_foreseen(error, stays), translate))
    if isinstance(error, KeyboardInterrupt):
        stopped = Message("{work} was stopped; {state}.", work=label, state=state)
        return in_words(stopped, translate)

    traceback.print_exception(error)
    return in_words(_unforeseen(error, label, state), translate)


def _foreseen(error: KirikoError, stays: str) -> Message:
    if not stays:
        return error.message
    return Message(
        "{error} But {thing} was kept (Undo removes it).", error=error.message, thing=stays
    )


def _unforeseen(error: BaseException, label: str, state: Message) -> Message:
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, MemoryError):
        return Message(
            "{work} ran out of memory{why}; {state}. Lower the resolution of display or viewer, or"
            " raise the tolerance.",
            work=label,
            why=f" ({text})" if text else "",
            state=state,
        )

    if isinstance(error, ReferenceError):  # from Python, for a datablock that is gone
        return Message(
            "{work} stopped because Undo or a script removed its data: start it again.",
            work=label,
        )

    if isinstance(error, OSError):
        return Message(
            "{work} couldn't read or write a file ({text}); {state}. Check the disk.",
            work=label,
            text=text,
            state=state,
        )

    return Message(
        "{work} failed ({kind}: {text}); {state}. Please report it with the file and the console"
        " text.",
        work=label,
        kind=type(error).__name__,
        text=text,
        state=state,
    )


@contextmanager
def errors_reported(operator: bpy.types.Operator, stays: Callable[[], str] = str) -> Iterator[None]:
    """Report any error within as one sentence, with what was kept; artists see no traceback."""
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        operator.report({"ERROR"}, sentence(error, operator.bl_label, stays()))
    finally:
        for text in take_reports():
            report(operator, "WARNING", text)
