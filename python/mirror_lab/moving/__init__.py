"""Moving sessions whose causes are withheld: pinocchio's ABA, an integrator and actuator laws of their own, the blind check's light.

Nothing here is shared with what it tests: no module of the product is imported where sessions are made.
"""
