"""Calibration of sensors: polynomials fitted to tables, with their uncertainty, saved as files and applied by
name."""

from .applying import apply_calibration as apply_calibration
from .polynomial import Calibration as Calibration
from .polynomial import CalibrationError as CalibrationError
from .polynomial import cross_validation as cross_validation
from .polynomial import fit_calibration as fit_calibration
from .storage import available_calibrations as available_calibrations
from .storage import load_calibration as load_calibration
from .storage import save_calibration as save_calibration
from .table import CalibrationTable as CalibrationTable
from .table import read_table as read_table
