"""The paper's own forms of the equations that `show` prints, in LaTeX and text.

An @ stands for the number of the chain.
"""

from __future__ import annotations

from dataclasses import dataclass

WHY_DEFINITIONS = (
    "Written out, these expressions would be too long to be read: they grow about threefold with "
    "every link. They are given as definitions instead, each by those before it, and vectors in "
    "the frames of their own items. Components that are not listed are zero."
)
AT_REST = (
    "Angular accelerations, and accelerations of joints, are those without accelerations of the "
    "coordinates."
)
COLUMNS = (
    "In equation 15, R and F are columns with an entry for each coordinate: R is what is left "
    "without accelerations, and F are the generalised forces of thrusts and joint torques."
)
FRAMES = (
    "Each item lies in the frame of the one before: turned by gamma about z, moved by x, y and z, "
    "turned by alpha about x, moved by d along z and turned by theta about z. Angles are in "
    "degrees; the coordinate adds to theta or, where it is a length, to d."
)


@dataclass(frozen=True)
class Form:
    """An equation as the paper has it, and its symbols: LaTeX, text and meaning."""

    latex: str = ""
    text: str = ""
    legend: tuple[tuple[str, str, str], ...] = ()


_LINK_LEGEND = (
    (r"\ddot{r}", "r̈", "acceleration of a link's joint, gravity included"),
    (r"\omega", "ω", "angular velocity of a link"),
    (r"\dot{\omega}", "ω̇", "angular acceleration of a link"),
    ("B_0", "B0", "mass of a link"),
    ("B_1", "B1", "skew matrix of a link's first moment of mass about its joint"),
    ("B_2 + B_3", "B2 + B3", "inertia matrix of a link about its joint"),
)
_SKEW = ((r"\tilde{\omega}", "ω̃", "skew matrix of the angular velocity"),)
_VECTORS = (
    (r"\mathcal{S}", "𝒮", "partial derivatives of a link's Gibbs function by its acceleration"),
    (
        r"\mathcal{R}",
        "ℛ",
        "partial derivatives of a link's Gibbs function by its angular acceleration",
    ),
)

FORMS = {
    2: Form(
        r"""S_{@} &= \sum_i \bigl[\tfrac{1}{2} B_0 \ddot{r}^T \ddot{r} - \ddot{r}^T B_1 \dot{\omega}
- \ddot{r}^T \tilde{\omega} B_1 \omega \\
&\quad {}+ \tfrac{1}{2} \dot{\omega}^T (B_2 + B_3) \dot{\omega}
+ \dot{\omega}^T \tilde{\omega} (B_2 + B_3) \omega\bigr]_i
\quad\text{up to terms free of accelerations}""",
        "S_@ = Σ_i [1/2·B0·r̈ᵀr̈ - r̈ᵀB1ω̇ - r̈ᵀω̃B1ω + 1/2·ω̇ᵀ(B2 + B3)ω̇ + ω̇ᵀω̃(B2 + B3)ω]_i\n"
        "    up to terms free of accelerations",
        (*_LINK_LEGEND, *_SKEW),
    ),
    5: Form(
        r"""\frac{\partial S_{@}}{\partial \ddot{\theta}_{@,i}} &=
\sum_{k>i} \Bigl(\frac{\partial \ddot{r}_k}{\partial \ddot{\theta}_{@,i}}\Bigr)^T \mathcal{S}_k
+ \sum_{k\ge i} \Bigl(\frac{\partial \dot{\omega}_k}{\partial \ddot{\theta}_{@,i}}\Bigr)^T
\mathcal{R}_k""",
        "∂S_@/∂θ̈_{@,i} = Σ_{k>i} (∂r̈_k/∂θ̈_{@,i})ᵀ𝒮_k + Σ_{k≥i} (∂ω̇_k/∂θ̈_{@,i})ᵀℛ_k",
        (*_LINK_LEGEND[:3], *_VECTORS),
    ),
    6: Form(
        r"""\mathcal{S} &= B_0 \ddot{r} - B_1 \dot{\omega} - \tilde{\omega} B_1 \omega \\
\mathcal{R} &= B_1 \ddot{r} + (B_2 + B_3) \dot{\omega} + \tilde{\omega} (B_2 + B_3) \omega""",
        "𝒮 = B0·r̈ - B1ω̇ - ω̃B1ω\nℛ = B1r̈ + (B2 + B3)ω̇ + ω̃(B2 + B3)ω",
        (*_LINK_LEGEND, *_SKEW, *_VECTORS),
    ),
    15: Form(
        legend=(
            ("I_{@}", "I_@", "mass matrix of the chain; entries (a,b) and (b,a) are equal"),
            (
                "R_{@}",
                "R_@",
                "what is left without accelerations: velocity terms, gravity, springs, dampers",
            ),
            ("F_{@}", "F_@", "generalised forces of thrusts and joint torques"),
        ),
    ),
    18: Form(
        r"I_H \ddot{\theta}_H &= R_H + F_H",
        "I_H·θ̈_H = R_H + F_H",
        (
            (
                "I_H",
                "I_H",
                "sum of the chains' bordered mass matrices, in the rows and columns of the table",
            ),
            (
                "R_H",
                "R_H",
                "sum of what they have without accelerations, in the table's rows, counted from −1",
            ),
            ("F_H", "F_H", "sum of their generalised forces, in the same rows"),
            (r"\ddot{\theta}_H", "θ̈_H", "unknowns of the hybrid system"),
        ),
    ),
}
