from .notebook import PlotWidget as PlotWidget
from .notebook import plot_widget as plot_widget
from .server import create_app as create_app
