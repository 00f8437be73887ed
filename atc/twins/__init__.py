"""The peridynamic twin of a molecular-dynamics run: body, conditions and material taken from the run and its potential,
both sides' fields on one grid with one kernel. `atc.twin` and ``atc twin``.

(The folder is not called `twin`, because `atc.twin` is the function.)
"""
