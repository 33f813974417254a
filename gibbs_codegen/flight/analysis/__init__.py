"""Balance, linear models, regulators and reach of a robot, from its generated module and SciPy.

trim              inputs and attitude of a steady motion                    (trim)
  equilibrium     coordinates at which the rotors can balance what acts     (trim)
  chosen_inputs   of all inputs that balance, the least or the safest       (trim)
linearise         A and B of small deviations from a state                  (linear_model)
lqr               gain of the regulator of least quadratic cost             (regulator)
  unreached       motions that inputs do not reach                          (linear_model)
reachable_wrenches  what the rotors can add to the wrench of hovering       (reachable_wrenches)
  polytope        vertices and half-spaces of a set by its supports         (reachable_wrenches)
numbers           what callers give, checked                                (arguments)
"""
