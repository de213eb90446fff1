"""Simulators, one for each calibration: `simulate(satellite, chosen, day, seed, effects)` gives columns and truth.

satellite : numbers of the catalogue, of a pair its letters
chosen : parameters of the simulation; day : GPS s of midnight; seed : int
effects : {slug: {parameter: value}}, hidden in the data
columns : {product: {column: array}}, as Level-1 files hold them
truth : plain dict, SI, um or mm where named so
"""
