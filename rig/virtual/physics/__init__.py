"""The sensors' equations on a fine grid, with every link of the chain air -> exchange -> body -> readout -> logger.

Finite volumes in space, second-order implicit steps of at most 10 ms in time; own equations, no closed-form sums.
Source of the models: Segales, Chilson and Salazar-Cerreno (2022), doi 10.5194/amt-15-2607-2022.
"""
