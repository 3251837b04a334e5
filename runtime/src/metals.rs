//! Complex indices of refraction of metals, by name.
//!
//! The numbers are those of Mitsuba 3.9.1 for its preset of the same chemical symbol: its measured spectra turned
//! into linear sRGB (`eta.value` and `k.value` of `roughconductor` in the variant `scalar_rgb`), to six decimals. Its
//! spectra name the luxpop.com database as their source, and each entry below what that names in turn.

/// One metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metal {
    /// English name, lower case.
    pub name: &'static str,
    /// Other spellings, the chemical symbol first.
    pub aliases: &'static [&'static str],
    /// Real parts of the index of refraction, linear sRGB.
    pub eta: [f64; 3],
    /// Extinction coefficients, linear sRGB.
    pub k: [f64; 3],
    /// What the spectra of Mitsuba name as their source, besides luxpop.com; empty where nothing is named.
    pub source: &'static str,
}

/// Palik's handbook, first volume.
const PALIK: &str = "Handbook of Optical Constants of Solids, ed. Palik, Academic Press 1985";
/// Palik's handbook, second volume.
const PALIK_2: &str = "Handbook of Optical Constants of Solids II, ed. Palik, Academic Press 1991";
/// A file put together from two tables that are named by these words only.
const LLNL_PALIK: &str = "concatenation of llnl_cxro and palik";

/// Every metal that has a name.
pub const METALS: [Metal; 15] = [
    metal(
        "aluminium",
        &["Al", "aluminum"],
        [1.657501, 0.880405, 0.521244],
        [9.223811, 6.269502, 4.837004],
        "",
    ),
    metal(
        "chromium",
        &["Cr"],
        [4.369668, 2.916505, 1.654905],
        [5.206547, 4.231306, 3.754699],
        LLNL_PALIK,
    ),
    metal(
        "copper",
        &["Cu"],
        [0.201005, 0.92375, 1.102215],
        [3.913262, 2.453045, 2.14209],
        "",
    ),
    metal(
        "gold",
        &["Au"],
        [0.143036, 0.375307, 1.442045],
        [3.982997, 2.385556, 1.603359],
        "",
    ),
    metal(
        "iridium",
        &["Ir"],
        [3.0863, 2.082191, 1.617915],
        [5.592153, 4.067088, 3.267312],
        LLNL_PALIK,
    ),
    metal(
        "mercury",
        &["Hg"],
        [2.398939, 1.440028, 0.90957],
        [6.327587, 4.371925, 3.421764],
        LLNL_PALIK,
    ),
    metal(
        "molybdenum",
        &["Mo"],
        [4.483974, 3.525131, 2.77631],
        [4.111437, 3.420827, 3.150607],
        LLNL_PALIK,
    ),
    metal(
        "nickel",
        &["Ni"],
        [2.367305, 1.663373, 1.467078],
        [4.498812, 3.050153, 2.345439],
        PALIK,
    ),
    metal(
        "niobium",
        &["Nb"],
        [3.420074, 2.790093, 2.395629],
        [3.441395, 2.737666, 2.579746],
        LLNL_PALIK,
    ),
    metal(
        "rhodium",
        &["Rh"],
        [2.585793, 1.860216, 1.554263],
        [6.78226, 4.702987, 3.976073],
        LLNL_PALIK,
    ),
    metal(
        "silver",
        &["Ag"],
        [0.155276, 0.116728, 0.138388],
        [4.828354, 3.122222, 2.146901],
        "",
    ),
    metal(
        "tantalum",
        &["Ta"],
        [2.062721, 2.392939, 2.627929],
        [2.40836, 1.741486, 1.947028],
        LLNL_PALIK,
    ),
    metal(
        "titanium nitride",
        &["TiN"],
        [1.64845, 1.150516, 1.379823],
        [3.368328, 1.943498, 1.102068],
        LLNL_PALIK,
    ),
    metal(
        "tungsten",
        &["W"],
        [4.370817, 3.300246, 2.998407],
        [3.500641, 2.604874, 2.273233],
        LLNL_PALIK,
    ),
    metal(
        "vanadium",
        &["V"],
        [4.277582, 3.512949, 2.761071],
        [3.491301, 2.889455, 3.111522],
        PALIK_2,
    ),
];

const fn metal(
    name: &'static str,
    aliases: &'static [&'static str],
    eta: [f64; 3],
    k: [f64; 3],
    source: &'static str,
) -> Metal {
    Metal {
        name,
        aliases,
        eta,
        k,
        source,
    }
}

/// The metal called `name`, in any case: its English name or its chemical symbol.
pub fn find(name: &str) -> Option<&'static Metal> {
    METALS.iter().find(|metal| {
        std::iter::once(&metal.name)
            .chain(metal.aliases)
            .any(|known| known.eq_ignore_ascii_case(name))
    })
}

/// All names with their symbols, for help and errors: `aluminium (Al), chromium (Cr), …`.
pub fn names() -> String {
    let names = METALS.iter().map(|m| format!("{} ({})", m.name, m.aliases[0]));
    names.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conductor::Conductor;

    #[test]
    fn every_name_leads_to_one_metal() {
        for metal in &METALS {
            for name in std::iter::once(&metal.name).chain(metal.aliases) {
                for spelling in [name.to_string(), name.to_uppercase(), name.to_lowercase()] {
                    assert_eq!(find(&spelling), Some(metal), "{spelling}");
                }
            }
        }
        assert_eq!(find("unobtainium"), None);
    }

    /// Gold is yellow, copper red, silver the brightest: a swapped channel or row shows.
    #[test]
    fn colours_are_those_of_the_metals() {
        let f0 = |name: &str| {
            let metal = find(name).expect("a preset");
            let conductor = Conductor::with_ior([0.1; 2], metal.eta, metal.k).expect("within range");
            conductor.fresnel.normal()
        };
        for name in ["gold", "copper"] {
            let colour = f0(name);
            assert!(colour.x > colour.y && colour.y > colour.z, "{name}: {colour}");
        }
        assert!(f0("gold").y > f0("copper").y);
        assert!(
            METALS
                .iter()
                .all(|m| f0(m.name).element_sum() <= f0("silver").element_sum())
        );
    }
}
