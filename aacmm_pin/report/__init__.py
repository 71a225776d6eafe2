"""Results as people see them: sentences, tables, plots, scenes in three dimensions, pages."""
