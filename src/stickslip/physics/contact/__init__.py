"""Contact mechanics: prior knowledge of friction from roughness, material, load and ageing.

It contains closed forms of contact mechanics, one record each, and priors of friction parameters with stated
widths; materials and friction pairs by name; and the comparison of several fitted contacts.
"""

from .adhesion import AdhesiveBall as AdhesiveBall
from .adhesion import plastic_coefficient as plastic_coefficient
from .ageing import Ageing as Ageing
from .ageing import oxide_ageing as oxide_ageing
from .asperities import GreenwoodWilliamson as GreenwoodWilliamson
from .catalogue import FrictionPair as FrictionPair
from .catalogue import Sliding as Sliding
from .catalogue import available_materials as available_materials
from .catalogue import available_pairs as available_pairs
from .catalogue import load_material as load_material
from .catalogue import load_pair as load_pair
from .comparing import ContactComparison as ContactComparison
from .comparing import compare_contacts as compare_contacts
from .hertz import Hertz as Hertz
from .iwan import LoopElements as LoopElements
from .iwan import in_series as in_series
from .iwan import maxwell_slip as maxwell_slip
from .iwan import of_backbone as of_backbone
from .iwan import of_loop as of_loop
from .material import Bodies as Bodies
from .material import Material as Material
from .mindlin import Mindlin as Mindlin
from .partial_slip import ExponentialContact as ExponentialContact
from .partial_slip import backbone as backbone
from .persson import Persson as Persson
from .preload import PreloadMagnet as PreloadMagnet
from .preload import PreloadSpring as PreloadSpring
from .priors import ContactPrior as ContactPrior
from .priors import ExpectedValue as ExpectedValue
from .priors import ball_prior as ball_prior
from .priors import rough_prior as rough_prior
from .roughness import Roughness as Roughness
from .roughness import measured as measured
from .roughness import of_topography as of_topography
from .roughness import read_topography as read_topography
from .roughness import self_affine as self_affine
from .wear import RunningIn as RunningIn
from .wear import sliding_path as sliding_path
from .wear import worn_depth as worn_depth
