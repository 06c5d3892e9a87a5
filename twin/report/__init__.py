"""What the model gets wrong, in words, numbers and an HTML page."""

from twin.report.contents import with_prediction as with_prediction
from twin.report.diagnosed import diagnosed as diagnosed
from twin.report.diagnosed import validated as validated
from twin.report.diagnosis_page import diagnosis_document as diagnosis_document
from twin.report.diagnosis_page import diagnosis_parts as diagnosis_parts
from twin.report.diagnosis_page import write_diagnosis as write_diagnosis
from twin.report.document import document as document
from twin.report.outcomes import gyro_document as gyro_document
from twin.report.outcomes import gyro_sentences as gyro_sentences
from twin.report.outcomes import identified as identified
from twin.report.page import compared as compared
from twin.report.page import comparison_parts as comparison_parts
from twin.report.page import write_page as write_page
from twin.report.style import write_parts as write_parts
from twin.report.words import sentences as sentences
from twin.report.words import transfer_sentences as transfer_sentences
