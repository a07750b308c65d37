"""HTML templates of reports and pages."""

from __future__ import annotations

import jinja2


def render_template(name: str, **values: object) -> str:
    """Render a template; every value is escaped unless it is marked as safe, and a missing value is an error.

    Args:
        name: File name of the template.
        values: Values of the template's variables.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("wherry.views", "templates"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template(name).render(**values)
