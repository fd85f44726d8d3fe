# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Words of headings and what they mean, in several languages.

To add a language, add its words to `WORDS`, and to the entries of `QUANTITIES` that have words of
their own.
"""

import re
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from .quantities import QUANTITIES
from .units import plain_text

WORDS: Mapping[str, str] = MappingProxyType(
    {
        "efficiency": "efficiency efficiencies eta eff effic wirkungsgrad rendement "
        "rendimiento rendimento eficiencia efficienza verim kpd \u6548\u7387 "
        "\u603b\u6548\u7387 \u043a\u043f\u0434",
        "stroke": "displacement stroke eps epsilon swash swivel swashplate "
        "schwenkwinkel schwenkung hub pumpenhub verstellung verstellgrad verstellverhaeltnis "
        "aussteuerung "
        "schluckgrad alpha displ cylindree cilindrada cilindrata carrera corsa course "
        "schwenkgrad ausschwenkung ausschwenkgrad foerdervolumen verdraengungsvolumen "
        "schluckvolumen plateau plato piatto "
        "\u6392\u91cf\u6bd4 \u6392\u91cf \u659c\u76d8",
        "temperature": "temp temperature temperatur temperatura temperaturen theta "
        "\u6e29\u5ea6 \u6cb9\u6e29",
        "pressure": "pressure press pres druck dp deltap druckdifferenz differenzdruck "
        "pression presion pressione pressao hochdruck \u538b\u529b \u538b\u5dee "
        "\u538b\u5f3a",
        "power": "power leistung pwr puissance potencia potenza \u529f\u7387",
        "torque": "torque drehmoment moment trq tq md mt couple par coppia moto "
        "torsion \u626d\u77e9 \u8f6c\u77e9 \u529b\u77e9",
        "speed": "speed drehzahl omega rpm regime vitesse velocity velocidad rev "
        "regimen giri velocita drehgeschwindigkeit winkelgeschwindigkeit spd vel "
        "\u8f6c\u901f \u89d2\u901f\u5ea6",
        "time": "time zeit stamp timestamp timestamps datetime date datum uhrzeit "
        "zeitstempel temps tiempo tempo hora heure fecha xvalue \u65f6\u95f4",
        "stage": "stage gang fahrbereich stufe fahrstufe gangstufe",
        "flow": "flow volumenstrom durchfluss forderstrom debit caudal portata "
        "\u6d41\u91cf",
        "engine": "engine eng input inlet in an antrieb eingang antriebswelle crankshaft "
        "\u8f93\u5165\u7aef eingangswelle verbrennungsmotor diesel dieselmotor ice ein e i "
        "moteur entree ingresso entrada motore vm vkm dm \u67f4\u6cb9\u673a "
        "\u53d1\u52a8\u673a \u8f93\u5165 \u8f93\u5165\u8f74",
        "output": "output out outlet ab aus a o abtrieb ausgang abtriebswelle "
        "ausgangswelle sortie salida uscita saida cardan gelenkwelle kardanwelle nout "
        "\u8f93\u51fa \u8f93\u51fa\u8f74 \u8f93\u51fa\u7aef",
        "load": "load last charge carga carico \u8d1f\u8f7d",
        "std": "std sigma uncertainty stdev scatter streuung unsicherheit deviation "
        "standardabweichung",
        "oil": "oil oel sump tank reservoir lube huile olio aceite fluid atf utto "
        "hydrauliktank oeltank sumpf oelsumpf \u6cb9\u6db2 \u6cb9",
        "pump": "pump pumpe pompe pompa bomba hydropumpe \u6cf5 \u53d8\u91cf\u6cf5",
        "one_side": "high low hoch nieder hochdruck niederdruck hp lp hd nd haute basse "
        "alta baja bassa system \u7cfb\u7edf \u9ad8\u538b \u4f4e\u538b",
        "boost": "boost lade ladedruck suralimentation admission admision aspirazione "
        "sovralimentazione sobrealimentacion",
        "neutral": "of the at and de du des del della dell di la le les el il der die das am pro "
        "shaft welle arbre albero eje value values val wert mean average avg mittel "
        "mittelwert moyenne media ist istwert actual measured meas mess gemessen "
        "messwert signal sensor raw filtered filt ratio total overall gesamt transmission "
        "gearbox getriebe trans cvt hmcvt angular plate "
        "position pos angle winkel relative norm normalized relativ relativer "
        "relativa relativo relatives relatif rel dell permille promille tilt setting "
        "verhaeltnis verstell taux rapport rapporto relacion inclinaison inclinazione "
        "mesure mesuree medido medida misurato misurata numero inclinacion posicion "
        "posizione angulo angolo global globale totale totales "
        "complessivo boite cambio caja transmision trasmissione hydraulik hydraulique "
        "hidraulico hidraulica idraulico idraulica diferencial differenziale "
        "differentielle \u503e\u89d2\u6bd4 \u503e\u89d2 \u5f00\u5ea6 "
        "\u76f8\u5bf9 percent delta d diff "
        "difference differential hydraulic hydraulisch hydr hyd sys degree grad "
        "elapsed test abs absolute lokal utc sec rotational rotation rotary rot tot ges "
        "median point \u6db2\u538b \u4f20\u52a8 "
        "\u53d8\u901f\u7bb1 bench pruefstand x",
        "loss": "loss losses verlust verluste perte perdida perdita \u635f\u5931",
        "other": "fuel kraftstoff "
        "ambient umgebung room raum target set setpoint soll sollwert so cmd command "
        "commanded demand demanded desired requested request limit limits max maximum "
        "min minimum coolant kuehlwasser wasser water fan luefter pto zapfwelle turbo "
        "exhaust abgas idle leerlauf wheel rad axle achse vehicle fahrzeug ground gps "
        "averaging mittelungszeit messzeit messdauer "
        "accuracy error fehler step increment volumetric volumetrisch vol mechanical "
        "mechanisch mech hydromechanical thermal combustion motor machine m1 case "
        "volumetrique volumique mecanique volumetrico mecanico mecanica volumetrica meccanico "
        "\u5bb9\u79ef \u673a\u68b0 "
        "housing gehaeuse winding inverter peu rotor stator bearing lager ring sun "
        "carrier number nr nummer no count start stop end duration dauer operating "
        "remaining operation betriebsstunden air luft intake manifold charge_air "
        "predicted prediction simulated simulation sim model modelled nominal nenn rated "
        "electric electrical elektrisch electrique "
        "barometric barometer atmospheric atmosphere luftdruck "
        "torsional weather humidity tyre tire reifen reference ref "
        "volumetrischer mechanischer drawbar barre barra tiro traction turbine "
        "turbolader intermediate layshaft countershaft pinion steg sonnenrad hohlrad "
        "hydromotor hydraulikmotor schalt achs seitenwelle kupplung clutch "
        "kuehlmittel halle hallen friction reib reibung indicated indiziert ripple "
        "roue rueda ruota ruote prise toma presa tdf ralenti consigne consigna "
        "massimo massima minimo minima maximo maxima maximal maximale minimal minimale "
        "\u9a6c\u8fbe \u51b7\u5374 \u51b7\u5374\u6c34 \u51b7\u5374\u6db2 \u6c34\u6e29 "
        "\u73af\u5883 \u52a8\u529b\u8f93\u51fa \u52a8\u529b\u8f93\u51fa\u8f74 \u8f6e\u901f "
        "\u8f66\u8f6e \u6700\u5927 \u6700\u5c0f \u76ee\u6807 \u989d\u5b9a "
        "\u9f7f\u5708 \u592a\u9633\u8f6e \u884c\u661f\u67b6 \u7535\u673a \u6da1\u8f6e \u8f66\u901f",
    }
)
"""Words by meaning, without accents; umlauts as two letters.

Words that mean one quantity alone are in its entry of `QUANTITIES`.
"""

COMPOUNDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "motordrehzahl": ("engine", "speed"),
        "motordrehmoment": ("engine", "torque"),
        "motormoment": ("engine", "torque"),
        "motorleistung": ("engine", "power"),
        "oiltemp": ("oil", "temperature"),
        "oeltemp": ("oil", "temperature"),
        "toil": ("oil", "temperature"),
        "toel": ("oil", "temperature"),
        "\u6cb9\u6e29": ("oil", "temperature"),
        "\u673a\u6cb9": ("engine", "oil"),
        "raddrehzahl": ("other", "speed"),
        "radmoment": ("other", "torque"),
    }
)
"""Compounds whose parts alone would mean something else: `Motor` in German is the engine."""


def _dictionary() -> dict[str, tuple[str, ...]]:
    words: dict[str, tuple[str, ...]] = {}
    own = ((quantity.name, quantity.words) for quantity in QUANTITIES)
    for meaning, listed in (*WORDS.items(), *own):
        for word in listed.split():
            words[word] = (*words.get(word, ()), meaning)
    return words | dict(COMPOUNDS)


MEANINGS = _dictionary()
"""Meanings of single words."""
_SHORT_PARTS = ("oel", "oil")
"""Short words that compounds begin with, as in `Oeltemperatur`."""


def _compound_parts() -> list[str]:
    """Return the words of which compounds are made, the longest first."""
    parts = []
    for word in MEANINGS:
        if len(word) > 3 or not word.isascii() or word in _SHORT_PARTS:
            parts.append(word)
    return sorted(parts, key=len, reverse=True)


_LONG = _compound_parts()
COMPOUND_PARTS = frozenset(_LONG)
"""Words that compounds are made of."""
_LINKS = ("", "s", "es", "n", "en")
_MISREAD = "\u00a1-\u00ac\u00ae\u00af\u00b4\u00b6\u00b8\u00bb\u00bf\ufffd"
"""Signs that stand in a name only where the encoding of the file was not recognised."""


@lru_cache(maxsize=4096)
def meanings_of(word: str) -> tuple[str, ...]:
    """Return the meanings of a word, those of its parts where it is composed; () if unknown."""
    if word in MEANINGS:
        return MEANINGS[word]
    for part in _LONG:
        if not word.startswith(part):
            continue
        for link in _LINKS:
            rest = word[len(part) :]
            if not rest.startswith(link) or rest == link:
                continue
            others = meanings_of(rest[len(link) :]) if len(rest) > len(link) + 1 else ()
            if others:
                return (*MEANINGS[part], *others)
    return ()


def words_of(name: str) -> list[str]:
    """Return the words of a name in their own case."""
    text = plain_text(name.replace("+/-", " std "))
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    text = re.sub(r"(?<=[^\W\d_])(?=\d)|(?<=\d)(?=[^\W\d_])", " ", text)
    text = re.sub(r"([^\x00-\u02ff]+)", r" \1 ", text)
    return re.findall(rf"[^\W_]+|[{_MISREAD}]+", text)
