"""Names that columns have in other labs, and the words for a standard and a comparison."""

from __future__ import annotations

import re
import unicodedata

#: Names that are like ours, in small letters and digits, without accents.
_SPELLINGS: dict[str, set[str]] = {
    "subject": {
        *("subj", "subjects", "subjectid", "subjid", "subjectnr", "participant", "participantid"),
        *("participantnumber", "observer", "observerid", "person", "listener", "vp", "vpn"),
        *("proband", "versuchsperson", "teilnehmer", "sujet", "participante", "sujeto"),
        *("soggetto", "partecipante"),
    },
    "response": {
        *("resp", "responses", "answer", "judgment", "judgement", "choice", "antwort", "urteil"),
        *("reponse", "respuesta", "risposta"),
    },
    "correct": {
        *("accuracy", "acc", "hit", "hits", "iscorrect", "responsecorrect", "respcorr", "corr"),
        *("keyrespcorr",),
    },
    "n_equal": {"nsame", "equal", "kequal"},
    "n_second": {"second", "ksecond"},
    "n_trials": {"trials", "ntotal", "total"},
    "standard": {
        *("std", "reference", "ref", "standardstimulus", "stimulusstandard", "standardintensity"),
        *("referencestimulus", "standardlevel"),
    },
    "comparison": {
        *("comp", "cmp", "test", "variable", "comparisonstimulus", "stimuluscomparison"),
        *("comparisonintensity", "teststimulus", "comparisonlevel"),
    },
    "standard_interval": {
        *("interval", "order", "position", "presentationorder", "stimulusorder", "stdinterval"),
        *("standardposition", "intervalstandard", "stdposition", "whichfirst", "firststimulus"),
    },
    "isi": {
        *("isis", "isims", "isisec", "interval", "intervals", "intervalms", "soa", "soams"),
        *("interstimulusinterval", "gap", "delay"),
    },
    "block": {
        *("blocks", "blocknr", "blockno", "blocknum", "blocknumber", "blockindex", "blockid"),
        *("run", "runnr"),
    },
    "session": {
        *("sessions", "sess", "sessionnr", "sessionno", "sessionnum", "sessionnumber"),
        *("sessionid", "day"),
    },
    "trial": {
        *("trialnr", "trialno", "trialnum", "trialnumber", "trialindex", "trialid", "trialn"),
    },
    "iti": {"itis", "itims", "intertrialinterval", "rsi"},
    "condition": {
        *("conditions", "cond", "conditionname", "bedingung", "kondition", "condicion"),
        *("condizione", "modality", "modalitat", "modalite", "modalidad", "modalita", "factor"),
        *("manipulation", "treatment", "context", "stimulustype", "stimtype", "side", "seite"),
        *("hand", "hemifield", "location", "attention", "load", "feedback", "drug"),
    },
}
#: Columns that may mark rows as practice, and the beginnings of texts that do so.
_PRACTICE_COLUMNS = {
    *("practice", "ispractice", "practicetrial", "phase", "stage", "part", "blocktype"),
    *("blockname", "trialtype", "typeoftrial", "block", "session", "ubung", "uebung"),
}
_PRACTICE_TEXTS = (
    *("practice", "practise", "training", "train", "warmup", "familiari", "instruction", "demo"),
    *("ubung", "uebung", "entrainement", "practica", "entrenamiento", "allenamento", "pratica"),
)
_PERCENTAGE_WORDS = ("percent", "pct", "prozent", "pourcent", "porcentaje", "proportion", "anteil")
_DECIBEL_WORDS = {"db", "dbspl", "dbsl", "dbhl", "dbfs", "dba", "dezibel"}
_FLAG_COLUMNS = {"practice", "ispractice", "practicetrial"}
#: Columns of which an empty cell says that nobody responded.
_RESPONSE_SIGNS = {
    *("key", "keys", "keyresp", "keyrespkeys", "keypress", "keypressed", "keyresprt", "resp"),
    *("response", "responsekey", "button", "rt", "rts", "reactiontime", "responsetime", "latency"),
}


def plain_name(name: str) -> str:
    """A name in small letters and digits, without accents.

    Examples
    --------
    >>> plain_name("R\u00e9ponse"), plain_name("key_resp.rt")
    ('reponse', 'keyresprt')
    """
    return re.sub("[^a-z0-9]", "", without_accents(name.lower()))


def without_accents(text: str) -> str:
    """A text whose letters have lost their accents."""
    decomposed = unicodedata.normalize("NFKD", text)
    return "".join(character for character in decomposed if not unicodedata.combining(character))


def looks_like(name: str, ours: str) -> bool:
    """Whether a column of a file looks like one of ours in another spelling."""
    plain = plain_name(name)
    return plain == ours.replace("_", "") or plain in _SPELLINGS.get(ours, ())


def is_response_sign(name: str) -> bool:
    """Whether an empty cell in this column says that nobody responded."""
    return plain_name(name) in _RESPONSE_SIGNS


def may_mark_practice(name: str) -> bool:
    """Whether a column may say which rows are practice."""
    return plain_name(name) in _PRACTICE_COLUMNS


def is_practice(name: str, text: str) -> bool:
    """Whether a cell of such a column says that its row is practice.

    Examples
    --------
    >>> is_practice("phase", "Practice 1"), is_practice("practice", "TRUE"), is_practice("phase", "1")
    (True, True, False)
    """
    plain = plain_name(text)
    if plain_name(name) in _FLAG_COLUMNS and plain in ("1", "10", "true", "yes"):
        return True
    return plain.startswith(_PRACTICE_TEXTS)


def unit_in(name: str) -> str:
    """The unit of a logarithm that the name of a column tells; empty where it tells none.

    Examples
    --------
    >>> unit_in("level1 (dB SPL)"), unit_in("dB2"), unit_in("log10_s1"), unit_in("feedback")
    ('dB', 'dB', 'log10', '')
    """
    words = re.findall("[a-z]+|[0-9]+", name.lower().replace("log10", "decadic"))
    if "decadic" in words:
        return "log10"
    is_decibel = any(word.startswith("decibel") or word in _DECIBEL_WORDS for word in words)
    return "dB" if is_decibel else ""


def is_percentage(name: str) -> bool:
    """Whether a column holds percentages or shares by its name.

    Examples
    --------
    >>> is_percentage("percent_second"), is_percentage("% second"), is_percentage("n_second")
    (True, True, False)
    """
    return "%" in name or any(word in plain_name(name) for word in _PERCENTAGE_WORDS)


#: Words by which a response, or the column of the interval, names one of two stimuli.
STANDARD_WORDS = frozenset({"standard", "std", "reference", "ref"})
COMPARISON_WORDS = frozenset({"comparison", "comp", "test", "variable"})
