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
}
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
    without_accents = unicodedata.normalize("NFKD", name.lower())
    return re.sub("[^a-z0-9]", "", without_accents)


def looks_like(name: str, ours: str) -> bool:
    """Whether a column of a file looks like one of ours in another spelling."""
    plain = plain_name(name)
    return plain == ours.replace("_", "") or plain in _SPELLINGS.get(ours, ())


def is_response_sign(name: str) -> bool:
    """Whether an empty cell in this column says that nobody responded."""
    return plain_name(name) in _RESPONSE_SIGNS


#: Words by which a response, or the column of the interval, names one of two stimuli.
STANDARD_WORDS = frozenset({"standard", "std", "reference", "ref"})
COMPARISON_WORDS = frozenset({"comparison", "comp", "test", "variable"})
