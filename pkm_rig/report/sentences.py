"""What a report explains, in English and German; `{...}` are its numbers, names and emphasised words."""

from __future__ import annotations

from typing import NamedTuple


class Sentence(NamedTuple):
    """One or more sentences, or what stands in a cell."""

    en: str
    de: str


SENTENCES: dict[str, Sentence] = {
    # result
    "scatter of visits": Sentence(
        "scatter of repeated visits, {n} degrees of freedom",
        "Streuung bei wiederholtem Anfahren, {n} Freiheitsgrade",
    ),
    "how to read the result": Sentence(
        "RMS distance of the tool point from its command at verification poses, in the report frame; {after} "
        "contains the noise of the measurement. The value after ± is U, the expanded uncertainty, k = {k}, rounded "
        "up to two digits; its value ends at the same place. Numbers without U are rounded at the place that is "
        "shown. Decision rule ({norm}): {what} only if at every payload the error falls by more than its U and, "
        "where a limit is stated, lies below it by its own U (guard band w).",
        "RMS-Abstand des Werkzeugpunkts von seinem Sollwert an den Prüfposen, im Berichtskoordinatensystem; {after} "
        "enthält das Rauschen der Messung. Der Wert nach ± ist U, die erweiterte Messunsicherheit mit k = {k}, auf "
        "zwei Stellen aufgerundet; der Messwert endet an derselben Stelle. Zahlen ohne U sind auf die angezeigte "
        "Stelle gerundet. Entscheidungsregel ({norm}): {what} nur, wenn bei jeder Nutzlast die Abweichung um mehr "
        "als ihr U abnimmt und, wo ein Grenzwert angegeben ist, um ihr eigenes U darunter liegt (Schutzabstand w).",
    ),
    "tables stay": Sentence("tables stay", "Tabellen bleiben"),
    "correction stays": Sentence("the correction stays", "die Korrektur bleibt"),
    "found by": Sentence(
        "measured with compensation off: {before}",
        "gemessen mit ausgeschalteter Kompensation: {before}",
    ),
    "left by host": Sentence(
        "the host's correction acts where this program leads the drives, measured so: {after}",
        "die Korrektur des Rechners wirkt, wo dieses Programm die Antriebe führt; so gemessen: {after}",
    ),
    "given up by host": Sentence(
        "{after} was measured with a correction by the host that was given up",
        "{after} wurde mit einer Korrektur des Rechners gemessen, die verworfen wurde",
    ),
    "left with tables": Sentence("measured with these tables: {after}", "gemessen mit diesen Tabellen: {after}"),
    "left unmeasured": Sentence("not measured in this campaign", "in dieser Kampagne nicht gemessen"),
    # identification, conditions, record
    "answered": Sentence("answered as {name}, {word} {serial}", "meldete sich als {name}, {word} {serial}"),
    "readings in rig time": Sentence("{n} in {hours} h of rig time", "{n} in {hours} h Anlagenzeit"),
    "nothing measured": Sentence("Nothing was measured.", "Es wurde nichts gemessen."),
    "not evaluated": Sentence("Not evaluated: {why}.", "Nicht ausgewertet: {why}."),
    "not identified": Sentence("Not identified: {why}.", "Nicht identifiziert: {why}."),
    "time before": Sentence("time before it {how}", "Zeit davor: {how}"),
    "none recorded": Sentence("None is recorded.", "Es ist keiner aufgezeichnet."),
    "accuracy of station": Sentence(
        "{angle} µrad, {distance} µm a reading; scale of ranges u = {scale} ppm",
        "{angle} µrad, {distance} µm je Messwert; Maßstab der Strecken u = {scale} ppm",
    ),
    # figures of a standard
    "virtual axis": Sentence(
        "Along the virtual axis {axis} from {low} to {high} m, payload {load} kg, compensation off: {targets} "
        "targets, {runs} runs from either side. Several drives move together, to which the standard does not apply; "
        "the figures contain the noise of the measurement.",
        "Entlang der virtuellen Achse {axis} von {low} bis {high} m, Nutzlast {load} kg, Kompensation "
        "ausgeschaltet: {targets} Zielpositionen, je {runs} Anfahrten von beiden Seiten. Es bewegen sich mehrere "
        "Antriebe gemeinsam, wofür die Norm nicht gilt; die Kennwerte enthalten das Rauschen der Messung.",
    ),
    "accuracy A": Sentence("accuracy A", "Positioniergenauigkeit A"),
    "repeatability R": Sentence("repeatability R", "Wiederholpräzision R"),
    "reversal error B": Sentence("reversal error B", "Umkehrspanne B"),
    "mean error M": Sentence("mean positioning error M", "mittlere Positionsabweichung M"),
    "systematic error E": Sentence("systematic positioning error E", "systematische Positionsabweichung E"),
    "poses of ISO 9283": Sentence(
        "Poses in a diagonal plane of the workspace, payload {load} kg, compensation off, each approached from one "
        "side. Commands and attained poses are compared in the report frame; the figures contain the noise of the "
        "measurement.",
        "Posen in einer Diagonalebene des Arbeitsraums, Nutzlast {load} kg, Kompensation ausgeschaltet, jede von "
        "einer Seite angefahren. Soll- und Istposen werden im Berichtskoordinatensystem verglichen; die Kennwerte "
        "enthalten das Rauschen der Messung.",
    ),
    # budget and tables
    "of the budget": Sentence(
        "Of the RMS position error after compensation; u standard uncertainty, type A by statistics of this "
        "campaign, B otherwise.",
        "Für die RMS-Positionsabweichung nach der Kompensation; u Standardunsicherheit, Typ A aus der Statistik "
        "dieser Kampagne, B auf andere Weise.",
    ),
    "host's correction": Sentence(
        "The host's correction: targets ({code}) are corrected before the drives are led to them. It acts where "
        "this program, or one that calls its library, leads the drives, and nowhere else; no table is on in any "
        "drive.",
        "Korrektur durch den Rechner: Sollwerte ({code}) werden korrigiert, bevor die Antriebe dorthin geführt "
        "werden. Sie wirkt, wo dieses Programm oder eines, das seine Bibliothek aufruft, die Antriebe führt, und "
        "nirgends sonst; in keinem Antrieb ist eine Tabelle eingeschaltet.",
    ),
    "of the tables": Sentence(
        "Corrections over the commanded drive positions, written to the idle bank, read back byte for byte and "
        "compared by CRC before all drives were switched together.",
        "Korrekturen über den Sollpositionen der Antriebe; in die ruhende Bank geschrieben, Byte für Byte "
        "zurückgelesen und durch CRC verglichen, bevor alle Antriebe gemeinsam umgeschaltet wurden.",
    ),
    "yes": Sentence("yes", "ja"),
    "no": Sentence("no", "nein"),
    "range of tables": Sentence(
        "Nothing was measured outside these temperatures and loads; a table is computed for one temperature and one "
        "load, and beyond them it is not shown to hold.",
        "Außerhalb dieser Temperaturen und Lasten wurde nichts gemessen; eine Tabelle ist für eine Temperatur und "
        "eine Last berechnet, darüber hinaus ist ihre Gültigkeit nicht nachgewiesen.",
    ),
    "range of correction": Sentence(
        "Nothing was measured outside these temperatures and loads; the correction is computed for one temperature "
        "and one load, and beyond them it is not shown to hold.",
        "Außerhalb dieser Temperaturen und Lasten wurde nichts gemessen; die Korrektur ist für eine Temperatur und "
        "eine Last berechnet, darüber hinaus ist ihre Gültigkeit nicht nachgewiesen.",
    ),
    # verification
    "maps by host": Sentence(
        "Measured at the verification poses, and predicted there by the identified model from where the drives were "
        "commanded to; all arrows in one scale. What is predicted after is what the host's correction leaves of the "
        "model's own prediction.",
        "Gemessen an den Prüfposen und dort vom identifizierten Modell aus den Sollpositionen der Antriebe "
        "vorhergesagt; alle Pfeile in einem Maßstab. Nachher vorhergesagt ist, was die Korrektur des Rechners von "
        "der Vorhersage des Modells übrig lässt.",
    ),
    "maps by tables": Sentence(
        "Measured at the verification poses, predicted by the identified model on a grid, all arrows in one scale. "
        "What is predicted after is the interpolation of the table; the standard uncertainty of the prediction is "
        "{u} µm RMS over the workspace.",
        "Gemessen an den Prüfposen, vom identifizierten Modell auf einem Gitter vorhergesagt, alle Pfeile in einem "
        "Maßstab. Nachher vorhergesagt ist, was die Interpolation der Tabelle übrig lässt; die Standardunsicherheit "
        "der Vorhersage beträgt {u} µm RMS über den Arbeitsraum.",
    ),
    "commanded": Sentence("The drives correct {what}.", "Die Antriebe korrigieren {what}."),
    "commanded and kept": Sentence(
        "The drives correct {what}; {kept} cannot be commanded and stay.",
        "Die Antriebe korrigieren {what}; {kept} sind nicht steuerbar und bleiben.",
    ),
    "only position": Sentence(
        "The drives correct the position of the tool point. The platform's rotation cannot be commanded: it stays, "
        "but the model knows it.",
        "Die Antriebe korrigieren die Position des Werkzeugpunkts. Die Verdrehung der Plattform ist nicht "
        "steuerbar: sie bleibt, aber das Modell kennt sie.",
    ),
    "of the comparison": Sentence(
        "Prediction of the uncompensated verification poses by other identifications of the same readings; contains "
        "the noise floor.",
        "Vorhersage der unkompensierten Prüfposen durch andere Identifikationen derselben Messwerte; enthält die "
        "Rauschgrenze.",
    ),
    "as good": Sentence("as good", "ebenso gut"),
    "refitted": Sentence(
        "Refitted per payload: one fit a payload, interpolated linearly in its mass.",
        "Je Nutzlast angepasst: eine Anpassung je Nutzlast, linear in der Masse interpoliert.",
    ),
    # residuals, diagnosis, parameters
    "of the residuals": Sentence(
        "Weighted sum of squares per degree of freedom {chi2}; the data decide {decided} of {all} directions.",
        "Gewichtete Quadratsumme je Freiheitsgrad {chi2}; die Daten bestimmen {decided} von {all} Richtungen.",
    ),
    "whole rig": Sentence("whole rig", "ganzer Prüfaufbau"),
    "cannot tell": Sentence(
        "These data cannot tell it from {others}; their predictions differ by {um} µm RMS at most.",
        "Diese Daten können es nicht unterscheiden von: {others}; die Vorhersagen weichen um höchstens {um} µm RMS "
        "voneinander ab.",
    ),
    "floor removed": Sentence("RMS, its noise floor removed", "RMS, ohne ihre Rauschgrenze"),
    "not tested": Sentence(
        "Not tested, for this campaign cannot show it: {what}.",
        "Nicht geprüft, da diese Kampagne es nicht zeigen kann: {what}.",
    ),
    "measure next": Sentence(
        "To measure next: {what} ({minutes} min); {command} writes it as a campaign file.",
        "Als Nächstes zu messen: {what} ({minutes} min); {command} schreibt es als Kampagnendatei.",
    ),
    "of the parameters": Sentence(
        "Deviations from nominal, the largest in units of its tolerance first.",
        "Abweichungen vom Nennwert, nach Größe in Einheiten der Toleranz geordnet.",
    ),
    "held by tolerance": Sentence(
        "Italic, and hollow in the picture: mostly held by its tolerance. Joint positions on base and platform act "
        "almost only through their difference; that shows as correlation.",
        "Kursiv, im Bild ohne Füllung: überwiegend durch die Toleranz bestimmt. Gelenkpositionen an Gestell und "
        "Plattform wirken fast nur über ihre Differenz; das zeigt sich als Korrelation.",
    ),
    "strongest correlations": Sentence("Strongest correlations:", "Stärkste Korrelationen:"),
    "with": Sentence("with", "mit"),
    "left open": Sentence("These readings leave open:", "Diese Messwerte lassen offen:"),
    # kinds of parameters
    "kind: strut_length": Sentence(
        "length of a strut between its joints",
        "Länge einer Strebe zwischen ihren Gelenken",
    ),
    "kind: platform_joint": Sentence("place of a joint on the platform", "Ort eines Gelenks an der Plattform"),
    "kind: base_joint": Sentence(
        "place of a joint on the base or on what a drive carries",
        "Ort eines Gelenks am Gestell oder an dem, was ein Antrieb trägt",
    ),
    "kind: pivot": Sentence(
        "point of the axis that a crank turns about",
        "Punkt der Achse, um die eine Kurbel dreht",
    ),
    "kind: guide_position": Sentence(
        "place of a plane that guides the platform, along its normal",
        "Ort einer führenden Ebene längs ihrer Normalen",
    ),
    "kind: guide_tilt": Sentence("tilt of a plane that guides the platform", "Neigung einer führenden Ebene"),
    "kind: axis_tilt": Sentence(
        "tilt of the direction in which a drive moves",
        "Neigung der Richtung, in der sich ein Antrieb bewegt",
    ),
    "kind: drive_scale": Sentence(
        "relative error of a drive's scale",
        "relative Abweichung des Maßstabs eines Antriebs",
    ),
    "kind: ln_stiffness": Sentence(
        "natural logarithm of a strut's stiffness over its nominal one",
        "natürlicher Logarithmus der Steifigkeit einer Strebe, bezogen auf den Nennwert",
    ),
    # terms
    "name: report frame": Sentence("Report frame", "Berichtskoordinatensystem"),
    "name: noise floor": Sentence("Noise floor", "Rauschgrenze"),
    "name: verification poses": Sentence("Verification poses", "Prüfposen"),
    "name: gap, noise floor of the gap, shrink": Sentence(
        "Gap, noise floor of the gap, shrink",
        "Abweichung bei zurückgehaltenen Daten, ihre Rauschgrenze, Abnahme",
    ),
    "name: nest outlier, innovation gate, model gate": Sentence(
        "Nest outlier, innovation gate, model gate",
        "Ausreißer am Nest, Innovationsschranke, Modellschranke",
    ),
    "name: parameters": Sentence("Parameters", "Parameter"),
    "name: directions": Sentence("Directions", "Richtungen"),
    "name: reflectors": Sentence("Reflectors", "Reflektoren"),
    "name: rig time": Sentence("Rig time", "Anlagenzeit"),
    "name: head of the campaign": Sentence("Head of the campaign", "Endwert der Hash-Kette"),
    "term: report frame": Sentence(
        "The rigid motion that brings the reflectors measured without payload closest to the commanded poses; "
        "fitted once, then kept. No figure contains an offset of the frame.",
        "Die Starrkörperbewegung, mit der die ohne Nutzlast gemessenen Reflektoren den Sollposen am nächsten "
        "kommen; einmal angepasst, dann beibehalten. Kein Kennwert enthält einen Versatz dieses Koordinatensystems.",
    ),
    "term: noise floor": Sentence(
        "Scatter of the measured pose over repeated visits of one target, scaled to the averaging of the verification.",
        "Streuung der gemessenen Pose bei wiederholtem Anfahren eines Ziels, umgerechnet auf die Mittelung der "
        "Prüfung.",
    ),
    "term: verification poses": Sentence(
        "Poses that no fit has seen, drawn from a seed that was fixed before the campaign.",
        "Posen, die in keine Anpassung eingehen; aus einem vor der Kampagne festgelegten Startwert gezogen.",
    ),
    "term: gap": Sentence(
        "The model's RMS error on readings that were withheld from it as a block; what repeated visits alone would "
        "leave there, another quantity than the noise floor of the verification; and the share by which the gap "
        "falls once the effect is in the model, with its interval of confidence.",
        "Die RMS-Abweichung des Modells an Messwerten, die ihm als Block vorenthalten wurden; was wiederholtes "
        "Anfahren allein dort übrig ließe, eine andere Größe als die Rauschgrenze der Prüfung; und der Anteil, um "
        "den die Abweichung abnimmt, sobald der Effekt im Modell ist, mit seinem Vertrauensintervall.",
    ),
    "term: left out": Sentence(
        "Reasons to leave out a reading that lies beyond six of its standard deviations from what all others say: "
        "of the nests, of the other reflectors of the same visit (its innovation), or of the identified model.",
        "Gründe, einen Messwert wegzulassen, der um mehr als sechs seiner Standardabweichungen von allen anderen "
        "abweicht: von denen der Nester, von den anderen Reflektoren derselben Pose (seine Innovation) oder vom "
        "identifizierten Modell.",
    ),
    "left out of the diagnosis": Sentence(
        "Left out of the diagnosis, which judges readings by all others whatever an effect may have changed:",
        "In der Diagnose nicht verwendet; sie prüft Messwerte an allen anderen, was auch immer ein Effekt verändert "
        "haben mag:",
    ),
    "more left out": Sentence("{n} more wrong readings.", "{n} weitere falsche Messwerte."),
    "term: directions": Sentence(
        "Independent combinations of the unknowns; the data decide one if they say more of it than its tolerances do.",
        "Unabhängige Kombinationen der Unbekannten; die Daten bestimmen eine, wenn sie mehr über sie aussagen als "
        "die Toleranzen.",
    ),
    "term: sigma": Sentence(
        "The stated standard deviation of one coordinate of a reading.",
        "Die angegebene Standardabweichung einer Koordinate eines Messwerts.",
    ),
    "term: rig time": Sentence(
        "Time since the rig's clock began with the campaign; simulated rigs run faster than the computer's clock.",
        "Zeit, seit die Uhr der Anlage mit der Kampagne begann; simulierte Anlagen laufen schneller als die Uhr des "
        "Rechners.",
    ),
    "term: head": Sentence(
        "Last value of a chain of hashes over every reading and event in the order in which they were stored; "
        "nothing before it can be changed without changing it.",
        "Letzter Wert einer Kette von Hashwerten über jeden Messwert und jedes Ereignis in der Reihenfolge ihrer "
        "Speicherung; nichts davor kann geändert werden, ohne ihn zu ändern.",
    ),
    "on the": Sentence("on the {part}", "{part}"),
    # statements of certificates
    "certificate: measurand": Sentence(
        "Position error: distance of the tool point from its commanded place at {poses} verification poses, which "
        "no fit has seen, after the rigid motion that fits the reflectors measured without payload best. Rotation "
        "error: the platform's, likewise. Before: compensation off; after: with the correction. What is measured "
        "contains the noise of the measurement. Noise floor: the scatter of the measured pose over repeated visits "
        "of one target, scaled to the averaging of the verification.",
        "Positionsabweichung: Abstand des Werkzeugpunkts von seinem Sollort an {poses} Prüfposen, die in keine "
        "Anpassung eingehen, nach der Starrkörperbewegung, die den ohne Nutzlast gemessenen Reflektoren am besten "
        "entspricht. Verdrehung: die der Plattform, ebenso. Vorher: Kompensation ausgeschaltet; nachher: mit der "
        "Korrektur. Die Messwerte enthalten das Rauschen der Messung. Rauschgrenze: die Streuung der gemessenen "
        "Pose bei wiederholtem Anfahren eines Ziels, umgerechnet auf die Mittelung der Prüfung.",
    ),
    "certificate: uncertainty": Sentence(
        "U is the expanded uncertainty: the standard uncertainty times the coverage factor k = {k}, which for a "
        "normal distribution covers about 95 % (JCGM 100).",
        "U ist die erweiterte Messunsicherheit: die Standardunsicherheit, multipliziert mit dem Erweiterungsfaktor "
        "k = {k}; bei einer Normalverteilung entspricht das einer Überdeckungswahrscheinlichkeit von etwa 95 % "
        "(JCGM 100).",
    ),
    "certificate: page": Sentence(
        "This page is made of the XML file with the same name, and of nothing else; the file is the certificate, "
        "and it alone can be signed and checked.",
        "Diese Seite ist aus der gleichnamigen XML-Datei erzeugt und aus nichts anderem; die Datei ist der "
        "Kalibrierschein, und nur sie kann signiert und geprüft werden.",
    ),
    "certificate: scope": Sentence(
        "The results relate only to the machine that is named here, in the state in which it was measured.",
        "Die Ergebnisse beziehen sich nur auf die hier bezeichnete Maschine in dem Zustand, in dem sie gemessen wurde.",
    ),
}


def sentence(key: str, language: str, **parts: object) -> str:
    """A sentence in a language with its parts; KeyError for one that the catalogue lacks."""
    text: str = getattr(SENTENCES[key], language)
    return text.format(**parts)
