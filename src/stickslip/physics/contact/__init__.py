"""Contact mechanics: prior knowledge of friction from roughness, material, load and ageing.

It contains closed forms of contact mechanics, one record each, and priors of friction parameters with stated
widths; materials and friction pairs by name; and the comparison of several fitted contacts.
"""

from ..._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
