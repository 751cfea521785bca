from .adaptive import Adaptive as Adaptive
from .optimal_pairs import DesignGoal as DesignGoal
from .optimal_pairs import optimal_design as optimal_design
from .power import power as power
from .study_design import StudyDesign as StudyDesign
from .study_design import read_study_design as read_study_design
from .trial_list import trial_list as trial_list
