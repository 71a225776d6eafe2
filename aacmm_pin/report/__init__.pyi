from .acceptance_page import CheckDetails, acceptance_document, history_blocks
from .accuracy_page import accuracy_document, length_document, map_document
from .calibration_page import calibration_document, calibration_summary, comment
from .check_page import check_document, check_summary
from .comparison_sentences import comparison_in_words, comparison_warning
from .demo_page import run_demo
from .diagnosis_page import diagnosis_document
from .diagnosis_table import diagnoses_document, diagnoses_summary, with_cause_texts
from .document import Document, Table
from .formats import content, require_format, suffixes
from .json_summaries import accuracy_summary, accuracy_table, length_summary, map_summary
from .plan_page import calibration_plan_document, plan_document
from .plots.style import without_latex
from .procedure_page import procedure_document

__all__ = [
    "CheckDetails",
    "Document",
    "Table",
    "acceptance_document",
    "accuracy_document",
    "accuracy_summary",
    "accuracy_table",
    "calibration_document",
    "calibration_plan_document",
    "calibration_summary",
    "check_document",
    "check_summary",
    "comment",
    "comparison_in_words",
    "comparison_warning",
    "content",
    "diagnoses_document",
    "diagnoses_summary",
    "diagnosis_document",
    "history_blocks",
    "length_document",
    "length_summary",
    "map_document",
    "map_summary",
    "plan_document",
    "procedure_document",
    "require_format",
    "run_demo",
    "suffixes",
    "with_cause_texts",
    "without_latex",
]
