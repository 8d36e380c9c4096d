"""Formation control with Greedy-GQ(λ) on simulated e-puck robots. ``import workbench as wb``; see the README."""

from .arena.picture import picture as picture
from .arena.tracks import Track as Track
from .arena.tracks import TrackConfig as TrackConfig
from .arena.tracks import make_track as make_track
from .arena.world import World as World
from .formation.config import SETTINGS as SETTINGS
from .formation.config import ConvoyConfig as ConvoyConfig
from .formation.convoy import Convoy as Convoy
from .formation.convoy import still_world as still_world
from .formation.policy import Policy as Policy
from .learning.config import LearnerConfig as LearnerConfig
from .learning.gq import GQ as GQ
from .learning.gq import GreedyGQ as GreedyGQ
from .learning.gq import UpdateBuffer as UpdateBuffer
from .learning.tiles import TileGrid as TileGrid
from .learning.tiles import Tiling as Tiling
from .study.figures import save_figure as save_figure
from .study.runs import Run as Run
from .study.runs import evaluate as evaluate
from .study.runs import evaluate_seeds as evaluate_seeds
from .study.runs import learn as learn
from .study.runs import learn_seeds as learn_seeds
from .study.runs import load_run as load_run
from .study.sweeps import Failed as Failed
from .study.sweeps import sweep as sweep
