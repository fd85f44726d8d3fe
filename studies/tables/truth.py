# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random bench tables written from known values.

A table is complete when its header gives name, unit and side of every quantity needed, its cells
can be read in one way only, and nothing in it contradicts that. Then an import should need no
question. Of other tables a question is right, and so are the true values; a wrong value never is.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .attacks import COLUMN_ATTACKS, LINE_ATTACKS, RPM, Array, Column, Draft
from .headings import PUBLIC_NAMES, PUBLIC_OTHERS

# Names by language; S of a shaft quantity is its side.
NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "en": {
        "displacement_ratio": (
            "displacement ratio",
            "Pump stroke",
            "stroke",
            "swash position",
        ),
        "engine_speed": (
            "engine speed",
            "Input Speed",
            "n_engine",
            "speed_in",
            "EngineSpeed",
        ),
        "engine_torque": ("engine torque", "input torque", "M_engine", "torque_in"),
        "engine_power": ("engine power", "Input power", "P_engine", "power_in"),
        "output_speed": ("output speed", "n_output", "speed_out", "OutputShaftSpeed"),
        "output_torque": (
            "output torque",
            "M_out",
            "torque_out",
            "Output shaft torque",
        ),
        "output_power": ("output power", "P_out", "power_out"),
        "load_torque": ("load torque", "T_load", "Load Torque"),
        "efficiency": (
            "efficiency",
            "eta",
            "Total efficiency",
            "Transmission Efficiency",
        ),
        "oil_temperature": ("oil temperature", "Oil temp", "T_oil", "sump temperature"),
    },
    "de": {
        "displacement_ratio": ("Pumpenhub", "Verstellung", "Hub"),
        "engine_speed": ("Motordrehzahl", "n_an", "Antriebsdrehzahl", "Drehzahl Motor"),
        "engine_torque": ("Motordrehmoment", "M_an", "Antriebsmoment", "Motormoment"),
        "engine_power": ("Motorleistung", "P_an", "Antriebsleistung"),
        "output_speed": ("Abtriebsdrehzahl", "n_ab", "Drehzahl Abtrieb"),
        "output_torque": ("Abtriebsdrehmoment", "M_ab", "Abtriebsmoment"),
        "output_power": ("Abtriebsleistung", "P_ab"),
        "load_torque": ("Lastmoment", "M_Last"),
        "efficiency": ("Wirkungsgrad", "eta", "Gesamtwirkungsgrad"),
        "oil_temperature": (
            "\u00d6ltemperatur",
            "T_\u00d6l",
            "Getriebe\u00f6ltemperatur",
        ),
    },
    "fr": {
        "displacement_ratio": ("Cylindr\u00e9e",),
        "engine_speed": ("R\u00e9gime moteur", "Vitesse d'entr\u00e9e"),
        "engine_torque": ("Couple moteur", "couple entr\u00e9e"),
        "engine_power": ("Puissance moteur",),
        "output_speed": ("Vitesse de sortie", "Vitesse sortie"),
        "output_torque": ("Couple de sortie", "Couple sortie"),
        "output_power": ("Puissance de sortie",),
        "load_torque": ("Couple de charge",),
        "efficiency": ("Rendement",),
        "oil_temperature": ("Temp\u00e9rature huile", "Temp\u00e9rature d'huile"),
    },
    "es": {
        "displacement_ratio": ("cilindrada",),
        "engine_speed": ("velocidad del motor", "r\u00e9gimen motor"),
        "engine_torque": ("par motor", "par de entrada"),
        "engine_power": ("potencia de entrada",),
        "output_speed": ("velocidad de salida",),
        "output_torque": ("par de salida",),
        "output_power": ("potencia de salida",),
        "load_torque": ("par de carga",),
        "efficiency": ("rendimiento", "eficiencia"),
        "oil_temperature": ("temperatura aceite", "temperatura del aceite"),
    },
    "it": {
        "displacement_ratio": ("cilindrata",),
        "engine_speed": ("giri motore", "velocit\u00e0 ingresso"),
        "engine_torque": ("coppia motore", "coppia ingresso"),
        "engine_power": ("potenza motore",),
        "output_speed": ("velocit\u00e0 uscita",),
        "output_torque": ("coppia uscita",),
        "output_power": ("potenza uscita",),
        "load_torque": ("coppia carico",),
        "efficiency": ("rendimento", "efficienza"),
        "oil_temperature": ("temperatura olio",),
    },
    "zh": {
        "displacement_ratio": ("\u6392\u91cf\u6bd4",),
        "engine_speed": ("\u53d1\u52a8\u673a\u8f6c\u901f", "\u8f93\u5165\u8f6c\u901f"),
        "engine_torque": ("\u53d1\u52a8\u673a\u626d\u77e9", "\u8f93\u5165\u8f6c\u77e9"),
        "engine_power": ("\u8f93\u5165\u529f\u7387",),
        "output_speed": ("\u8f93\u51fa\u8f6c\u901f",),
        "output_torque": ("\u8f93\u51fa\u626d\u77e9", "\u8f93\u51fa\u8f6c\u77e9"),
        "output_power": ("\u8f93\u51fa\u529f\u7387",),
        "load_torque": ("\u8d1f\u8f7d\u626d\u77e9",),
        "efficiency": ("\u6548\u7387", "\u603b\u6548\u7387"),
        "oil_temperature": ("\u6cb9\u6e29",),
    },
}
# Further names, from headings of public reports and data sheets.
FURTHER_NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "en": {
        "displacement_ratio": (
            "pump displacement",
            "relative displacement",
            "rel. displacement",
            "swash plate position",
        ),
        "engine_speed": (
            "engine rpm",
            "input shaft speed",
        ),
        "engine_torque": (
            "input shaft torque",
            "torque in",
        ),
        "output_speed": (
            "output shaft speed",
            "n_out",
        ),
        "output_torque": ("torque output",),
        "oil_temperature": (
            "transmission oil temperature",
            "oil sump temp",
        ),
        "efficiency": ("overall efficiency",),
    },
    "de": {
        "displacement_ratio": (
            "Verstellgrad",
            "Pumpenverstellung",
            "rel. Schwenkwinkel",
            "relatives F\u00f6rdervolumen",
            "Ausschwenkgrad",
        ),
        "engine_speed": (
            "Eingangsdrehzahl",
            "n_ein",
        ),
        "engine_torque": (
            "Eingangsmoment",
            "M_ein",
        ),
        "output_speed": (
            "Ausgangsdrehzahl",
            "Gelenkwellendrehzahl",
        ),
        "output_torque": (
            "Ausgangsmoment",
            "Drehmoment Ausgang",
        ),
        "oil_temperature": ("\u00d6lsumpftemperatur",),
    },
    "fr": {
        "displacement_ratio": (
            "cylindr\u00e9e relative",
            "taux de cylindr\u00e9e",
            "angle plateau",
        ),
        "engine_speed": ("vitesse arbre d'entr\u00e9e",),
        "output_speed": ("vitesse arbre de sortie",),
        "output_torque": ("couple arbre de sortie",),
        "oil_temperature": ("temp. huile",),
    },
    "es": {
        "displacement_ratio": (
            "cilindrada relativa",
            "relaci\u00f3n de cilindrada",
        ),
        "engine_speed": ("velocidad del eje de entrada",),
        "output_speed": ("velocidad del eje de salida",),
        "oil_temperature": ("temp. aceite",),
    },
    "it": {
        "displacement_ratio": (
            "cilindrata relativa",
            "rapporto di cilindrata",
            "inclinazione piatto",
        ),
        "engine_speed": ("velocit\u00e0 albero ingresso",),
        "output_speed": ("velocit\u00e0 in uscita",),
        "output_torque": (
            "coppia in uscita",
            "coppia albero uscita",
        ),
        "oil_temperature": ("temperatura dell'olio",),
    },
    "zh": {
        "displacement_ratio": (
            "\u6cf5\u6392\u91cf\u6bd4",
            "\u76f8\u5bf9\u6392\u91cf",
            "\u659c\u76d8\u5f00\u5ea6",
        ),
        "engine_speed": (
            "\u8f93\u5165\u8f74\u8f6c\u901f",
            "\u8f93\u5165\u7aef\u8f6c\u901f",
        ),
        "output_speed": ("\u8f93\u51fa\u8f74\u8f6c\u901f",),
        "output_torque": ("\u8f93\u51fa\u8f74\u626d\u77e9",),
        "oil_temperature": ("\u6cb9\u6db2\u6e29\u5ea6",),
    },
}
# Unit texts by kind: size and zero in SI.
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "part": {"%": (0.01, 0.0), "-": (1.0, 0.0)},
    "speed": {
        "rpm": (RPM, 0.0),
        "1/min": (RPM, 0.0),
        "min-1": (RPM, 0.0),
        "rad/s": (1.0, 0.0),
        "U/min": (RPM, 0.0),
        "tr/min": (RPM, 0.0),
        "deg/s": (np.pi / 180.0, 0.0),
        "radps": (1.0, 0.0),
        "rad_s": (1.0, 0.0),
        "x1000 rpm": (1e3 * RPM, 0.0),
        "\u00b0/s": (np.pi / 180.0, 0.0),
    },
    "torque": {
        "Nm": (1.0, 0.0),
        "N\u00b7m": (1.0, 0.0),
        "kNm": (1e3, 0.0),
        "lb-ft": (1.3558179483, 0.0),
        "ft lb": (1.3558179483, 0.0),
        "daNm": (10.0, 0.0),
        "kgf m": (9.80665, 0.0),
        "lbf-ft": (1.3558179483, 0.0),
        "in-lb": (0.1129848290, 0.0),
        "N cm": (0.01, 0.0),
    },
    "power": {
        "kW": (1e3, 0.0),
        "W": (1.0, 0.0),
        "hp": (745.69987, 0.0),
        "PS": (735.49875, 0.0),
    },
    "temperature": {
        "\u00b0C": (1.0, 0.0),
        "degC": (1.0, 0.0),
        "\u00b0F": (5.0 / 9.0, 32.0),
        "K": (1.0, 273.15),
    },
}
KINDS = {
    "displacement_ratio": "part",
    "efficiency": "part",
    "engine_speed": "speed",
    "output_speed": "speed",
    "engine_torque": "torque",
    "output_torque": "torque",
    "load_torque": "torque",
    "engine_power": "power",
    "output_power": "power",
    "oil_temperature": "temperature",
}
ROUTES = (
    ("load_torque", "efficiency"),
    ("engine_torque", "output_speed", "output_torque"),
    ("engine_power", "output_power"),
    ("engine_torque", "output_speed", "output_torque", "efficiency"),
    ("output_speed", "output_torque", "efficiency"),
    ("engine_torque", "load_torque"),
    ("engine_power", "output_speed", "output_torque", "load_torque"),
)
"""Quantities beside stroke and engine speed by which a bench gives load and efficiency."""
SUFFIXES = {
    "part": ("%",),
    "speed": ("rpm", "radps", "rad_s"),
    "torque": ("Nm",),
    "power": ("kW",),
    "temperature": ("degC",),
}
"""Units that follow a name behind an underscore."""
NO_VALUES = ("", "n/a", "NaN", "-9999", "---", "65535", "6553.5", "#DIV/0!", "#N/A")
"""Cells of tests that hold no value."""
CONVENTIONAL = {"torque": ("Nm",), "power": ("kW", "W"), "speed": ("rpm", "rad/s")}
"""Units that a header without units may mean; nothing in such a table shows others."""
# Columns that hold none of the quantities: header, typical value, spread.
OTHERS = (
    ("ambient temperature [\u00b0C]", 22.0, 2.0),
    ("fuel rate [kg/h]", 14.0, 4.0),
    ("coolant temp [degC]", 85.0, 3.0),
    ("boost pressure [bar]", 1.5, 0.3),
    ("engine speed setpoint [rpm]", 1500.0, 300.0),
    ("fan speed [rpm]", 2100.0, 300.0),
    ("Solldrehzahl Motor [1/min]", 1500.0, 300.0),
    ("volumetric efficiency [%]", 95.0, 2.0),
    ("engine torque limit [Nm]", 700.0, 50.0),
    ("PTO speed [rpm]", 540.0, 5.0),
    ("humidity [%]", 40.0, 9.0),
    ("vehicle speed [km/h]", 12.0, 5.0),
    ("K\u00fchlwassertemperatur [\u00b0C]", 85.0, 3.0),
    ("Umgebungstemperatur [\u00b0C]", 22.0, 2.0),
    ("temp\u00e9rature eau [\u00b0C]", 85.0, 3.0),
    ("temperatura ambiente [\u00b0C]", 22.0, 2.0),
    ("\u51b7\u5374\u6db2\u6e29\u5ea6 [\u00b0C]", 85.0, 3.0),
    ("Ladedruck [bar]", 1.5, 0.3),
    ("pression de suralimentation [bar]", 1.5, 0.3),
    ("presi\u00f3n de sobrealimentaci\u00f3n [bar]", 1.5, 0.3),
    ("consumo [l/h]", 20.0, 3.0),
    ("Zapfwellendrehzahl [1/min]", 540.0, 5.0),
    ("relative humidity [%]", 40.0, 9.0),
    ("Luftdruck [mbar]", 1000.0, 9.0),
    ("case drain flow [l/min]", 3.0, 0.5),
    ("valve current [mA]", 400.0, 90.0),
    ("load factor [%]", 60.0, 9.0),
    ("Abgastemperatur [\u00b0C]", 350.0, 40.0),
)
# Columns that make a table ambiguous: quantity that they may be taken for, header.
RIVALS = (
    ("engine_speed", "engine speed"),
    ("engine_speed", "speed"),
    ("output_torque", "torque"),
    ("efficiency", "efficiency"),
    ("output_speed", "wheel speed"),
    ("engine_torque", "Torque 2"),
)


@dataclass(frozen=True)
class RandomTable:
    """A table and what is true of it.

    Attributes:
        text: of the file.
        encoding: by which it is written.
        truth: SI values by quantity, shape (n,) each.
        rounding: largest error of each quantity by the digits written, as a part.
        complete: whether an import needs no question.
        features: what was drawn, for reports.
    """

    text: str
    encoding: str
    truth: dict[str, Array]
    rounding: float
    complete: bool
    features: dict[str, Any] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write the file."""
        path.write_bytes(self.text.encode(self.encoding))


def bench_truth(rng: np.random.Generator, tests: int) -> dict[str, Array]:
    """Draw the quantities of tests of a transmission with one stage."""
    stroke = np.round(
        np.linspace(-0.98, 0.98, tests) + rng.uniform(-0.005, 0.005, tests), 4
    )
    stroke = rng.permutation(stroke)
    speed = rng.uniform(850.0, 2150.0, tests) * RPM
    load = rng.uniform(90.0, 600.0, tests)
    efficiency = rng.uniform(0.62, 0.86, tests)
    output_speed = speed * (1.2 + 0.37 * stroke) * rng.uniform(0.98, 1.0, tests)
    return {
        "displacement_ratio": stroke,
        "engine_speed": speed,
        "load_torque": load,
        "efficiency": efficiency,
        "engine_torque": load / efficiency,
        "output_speed": output_speed,
        "output_torque": load * speed / output_speed,
        "engine_power": load * speed / efficiency,
        "output_power": load * speed,
        "oil_temperature": rng.uniform(55.0, 95.0, tests),
    }


def random_table(rng: np.random.Generator) -> RandomTable:
    """Draw a table."""
    truth = bench_truth(rng, int(rng.integers(6, 30)))
    tests = len(truth["efficiency"])
    language = str(rng.choice(list(NAMES)))
    route = ROUTES[rng.integers(len(ROUTES))]
    quantities = ["displacement_ratio", "engine_speed", *route]
    if rng.random() < 0.4:
        quantities.append("oil_temperature")
    decimal = str(rng.choice([".", ","]))
    separator = str(
        rng.choice([";", "\t", "|"] if decimal == "," else [",", ";", "\t", "|"])
    )
    grouping = "," if decimal == "." else "."
    thousands = str(rng.choice(["", "", "", "", grouping, " ", "'", "\u00a0"]))
    if thousands == separator:
        thousands = ""
    style = str(
        rng.choice(
            ["[]", "()", "row", "/", "_", ",", "none"],
            p=[0.35, 0.15, 0.15, 0.1, 0.1, 0.05, 0.1],
        )
    )
    complete = style != "none"
    columns: list[Column] = []
    rounding = 1e-4
    for quantity in quantities:
        further = FURTHER_NAMES[language].get(quantity, ())
        public = PUBLIC_NAMES[language][quantity]
        name = str(rng.choice([*NAMES[language][quantity], *further, *public]))
        kind = KINDS[quantity]
        unit = _unit(rng, kind, style)
        size, zero = UNITS[kind].get(unit, (1.0, 0.0))
        values = truth[quantity] / size + zero
        digits = int(rng.integers(3, 6)) - int(
            np.floor(np.log10(np.max(np.abs(values))))
        )
        digits = int(np.clip(digits, 0, 6))
        rounding += 0.5 * 10.0**-digits / max(float(np.min(np.abs(values))), 1e-2)
        cells = [_number(value, digits, decimal, thousands) for value in values]
        columns.append(Column(quantity, name, unit, cells, values))
    others = (*OTHERS, *PUBLIC_OTHERS)
    n_others = int(rng.integers(0, 4))
    for index in rng.choice(len(others), n_others, replace=False):
        header, middle, spread = others[index]
        values = rng.normal(middle, spread, tests)
        cells = [_number(v, 1, decimal, "") for v in values]
        columns.append(Column("", header, "", cells, values))

    def written(number: float, digits: int) -> str:
        return _number(number, digits, decimal, thousands)

    draft = Draft(columns, truth, written, style != "none")
    rival = ""
    attack = ""
    choice = rng.random()
    if choice < 0.12:
        quantity, rival = RIVALS[rng.integers(len(RIVALS))]
        unit = next(iter(UNITS[KINDS[quantity]]))
        size, _ = UNITS[KINDS[quantity]][unit]
        values = truth[quantity] / size * rng.uniform(0.7, 1.0, tests)
        draft.add(rival, unit, values)
        complete = False
    elif choice < 0.37:
        change = COLUMN_ATTACKS[rng.integers(len(COLUMN_ATTACKS))]
        still_complete = change(rng, draft)
        if still_complete is not None:
            attack = change.__name__
            complete = complete and still_complete
    unknown = ""
    if rng.random() < 0.05:
        index = int(rng.integers(len(quantities)))
        unknown = "qx"
        columns[index].unit = unknown
        complete = False
    rng.shuffle(columns)
    if rng.random() < 0.5:
        values = np.arange(1.0, tests + 1.0)
        name = str(rng.choice(["Test", "No.", "Nr", "m", "#1"]))
        cells = [str(index + 1) for index in range(tests)]
        columns.insert(0, Column("", name, "", cells, values))
    if rng.random() < 0.2:
        name = str(rng.choice(["Comment", "remark", "Bemerkung"]))
        columns.append(Column("", name, "", [""] * tests, np.zeros(tests)))
    missing = rng.random() < 0.2
    if missing:
        for _ in range(int(rng.integers(1, 3))):
            cells = columns[rng.integers(len(columns))].cells
            code = str(rng.choice(NO_VALUES))
            cells[rng.integers(tests)] = code.replace(".", decimal)
    lines = _lines(columns, style)
    if not attack and rng.random() < 0.3:
        change_lines = LINE_ATTACKS[rng.integers(len(LINE_ATTACKS))]
        first = 2 if style == "row" else 1
        still_complete = change_lines(rng, lines, draft, first)
        if still_complete is not None:
            attack = change_lines.__name__
            complete = complete and still_complete
    if rng.random() < 0.2:
        lines.insert(0, ["Bench report 7"] + [""] * (len(lines[0]) - 1))
    text = "\n".join(
        separator.join(_quoted(cell, separator) for cell in line) for line in lines
    )
    encoding = "utf-8"
    if rng.random() < 0.3:
        try:
            text.encode("cp1252")
            encoding = "cp1252"
        except UnicodeEncodeError:
            encoding = str(rng.choice(["utf-16", "gb18030"]))
    features = {
        "language": language,
        "route": route,
        "style": style,
        "decimal": decimal,
        "separator": separator,
        "thousands": thousands,
        "rival": rival,
        "unknown": unknown,
        "attack": attack,
        "missing": missing,
        "encoding": encoding,
    }
    return RandomTable(f"{text}\n", encoding, truth, rounding, complete, features)


def _number(value: float, digits: int, decimal: str, thousands: str) -> str:
    text = f"{value:,.{digits}f}" if thousands else f"{value:.{digits}f}"
    signs: dict[str, str | int | None] = {",": thousands, ".": decimal}
    return text.translate(str.maketrans(signs))


def _quoted(cell: str, separator: str) -> str:
    if separator in cell:
        return f'"{cell}"'
    return cell


def _unit(rng: np.random.Generator, kind: str, style: str) -> str:
    """Draw the unit of a column."""
    if style == "_":
        return str(rng.choice(SUFFIXES[kind]))
    if style == "none" and kind in CONVENTIONAL:
        return str(rng.choice(CONVENTIONAL[kind]))
    return str(rng.choice(list(UNITS[kind])))


def _lines(columns: list[Column], style: str) -> list[list[str]]:
    """Return header, row of units and rows."""
    forms = {
        "[]": "{} [{}]",
        "()": "{} ({})",
        "/": "{} / {}",
        "_": "{}_{}",
        ",": "{}, {}",
    }
    header = []
    for column in columns:
        text = column.name
        if style in forms and column.unit:
            text = forms[style].format(column.name, column.unit)
        header.append(text)
    lines = [header]
    if style == "row":
        lines.append([column.unit or "-" for column in columns])
    lines += [
        list(row) for row in zip(*(column.cells for column in columns), strict=True)
    ]
    return lines
