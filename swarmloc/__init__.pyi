from host.behaviour.catalogue import BehaviourEntry
from host.behaviour.interface import Behaviour, Command, Situation
from host.calibration.result import Calibration
from host.calibration.robot_file import update as update_robot_file
from host.config import RobotConfig, load_config
from host.errors import UserError
from host.estimator.clairvoyant import Clairvoyant
from host.estimator.interface import Filter
from host.estimator.last_reading import LastReading
from host.estimator.perera2021 import Perera2021Filter
from host.estimator.phd import PhdFilter
from host.estimator.pmb import PmbFilter
from host.estimator.profiles import FilterEntry
from host.estimator.profiles import make as make_filter
from host.evaluation.metrics import Row, gospa
from host.geometry import rotation, to_frame, to_parent
from host.localizer import Localizer
from host.messages import (
    Bearings,
    Bodies,
    Displacement,
    Estimate,
    Health,
    Message,
    Positions,
    Scan,
    Truth,
)
from host.recording.elsewhere.mrclam import load_dataset as load_mrclam
from host.recording.elsewhere.optiodom import read_runs as load_optiodom
from host.recording.log import Recorder, Recording, RecordingHeader
from host.registry import BEHAVIOURS, BOARDS, FILTERS, LIDARS, SCENARIOS, load_plugin
from host.sessions.calibrating.calibrate import calibrate_from as calibrate
from host.sessions.offline.evaluating import score_sources as evaluate
from host.sessions.offline.localizing import localize
from host.sessions.recordings.runs import Run, load_recording
from host.sessions.recordings.runs import simulate_scenario as simulate
from host.simulation.devices.catalogue import BoardEntry, LidarEntry
from host.simulation.world.scenarios import Scenario

__all__ = ["load_mrclam", "load_optiodom", "load_recording", "simulate"]
__all__ += ["Recorder", "Recording", "RecordingHeader", "Run"]
__all__ += ["Calibration", "Localizer", "Row", "calibrate", "evaluate", "gospa", "localize"]
__all__ += ["RobotConfig", "UserError", "load_config", "update_robot_file"]
__all__ += ["Clairvoyant", "Filter", "LastReading", "Perera2021Filter", "PhdFilter", "PmbFilter"]
__all__ += ["make_filter"]
__all__ += ["BEHAVIOURS", "BOARDS", "FILTERS", "LIDARS", "SCENARIOS", "load_plugin"]
__all__ += ["Behaviour", "Command", "Situation"]
__all__ += ["BehaviourEntry", "BoardEntry", "FilterEntry", "LidarEntry", "Scenario"]
__all__ += ["Bearings", "Bodies", "Displacement", "Estimate"]
__all__ += ["Health", "Message", "Positions", "Scan", "Truth"]
__all__ += ["rotation", "to_frame", "to_parent"]
