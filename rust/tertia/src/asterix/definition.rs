use std::str::SplitAsciiWhitespace;
use std::sync::LazyLock;

/// Description of a column.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Item and part, as in `040/RHO`.
    pub name: String,
    /// Value of the least significant bit; 1 for codes.
    pub scale: f64,
    /// Unit of the scale; empty if there is none.
    pub unit: String,
}

/// Bits of a structure that become a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bits {
    pub column: usize,
    pub first: usize,
    pub count: usize,
    pub signed: bool,
}

/// A fixed number of octets, and the bits taken from them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Octets {
    pub count: usize,
    pub bits: Vec<Bits>,
}

/// The structure of an item.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Structure {
    Fixed(Octets),
    /// Parts whose last bit indicates whether the next part follows; only the last part may lack that bit.
    Extended(Vec<Octets>, bool),
    /// Groups of octets, preceded by their count.
    Counted(usize, usize),
    /// Groups of octets; the last bit of each group indicates whether another one follows.
    Repeated(usize),
    /// Octets, the first of which is their number.
    Explicit,
    Compound(Items),
    /// Items of the same record by their numbers, in any order; the first octet is their count.
    Sequence,
}

/// Items with an FSPEC that indicates which of them are present.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Items {
    /// Largest number of octets of the FSPEC.
    pub fspec: usize,
    /// Items in the order of the FSPEC bits; a spare bit has none.
    pub items: Vec<Option<Structure>>,
    /// Alternative items for records in which a column is not 0, from the point at which this column is read.
    pub other: Option<(usize, Box<Items>)>,
}

/// Structure of the records of a category, valid for one or more editions of its document.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// Category of the records.
    pub category: u8,
    /// Editions of the document, the newest first.
    pub editions: Vec<String>,
    /// Columns of the records.
    pub fields: Vec<Field>,
    pub(super) record: Items,
}

/// Beginning of the line between two lists of items.
const WHERE: &str = "where ";

/// Returns all definitions; those of a category are sorted from the newest.
pub fn definitions() -> &'static [Definition] {
    static ALL: LazyLock<Vec<Definition>> = LazyLock::new(|| {
        let text = include_str!("definitions.txt");
        text.split("\n\n").filter_map(definition).collect()
    });
    &ALL
}

/// Parses the definition in a paragraph; `None` if it is a comment.
fn definition(text: &str) -> Option<Definition> {
    let mut lines = text.lines();
    let mut head = lines.next()?.split(' ');
    if head.next()? != "category" {
        return None;
    }
    let category = head.next()?.parse().ok()?;
    let editions = head.map(String::from).collect();
    let lines: Vec<&str> = lines.collect();
    let mut fields = Vec::new();
    let mut lists = lines.split(|line| line.starts_with(WHERE));
    let mut record = items(lists.next()?, &mut fields)?;
    if let Some(other) = lists.next() {
        let selector = lines.iter().find_map(|line| line.strip_prefix(WHERE))?;
        let column = fields.iter().position(|field| field.name == selector)?;
        record.other = Some((column, Box::new(items(other, &mut fields)?)));
    }
    Some(Definition { category, editions, fields, record })
}

/// Parses the items of a record, one per line, after a line with the length of the FSPEC.
fn items(lines: &[&str], fields: &mut Vec<Field>) -> Option<Items> {
    let (head, lines) = lines.split_first()?;
    let fspec = head.strip_prefix("fspec ")?.parse().ok()?;
    let item = |line: &&str| {
        let spaced = line.replace('(', " ( ").replace(')', " ) ");
        let mut parser = Parser { words: spaced.split_ascii_whitespace(), fields };
        let name = parser.words.next().filter(|&name| name != "-")?;
        parser.structure(name)
    };
    Some(Items { fspec, items: lines.iter().map(item).collect(), other: None })
}

/// Parser of lists in brackets.
struct Parser<'a, 'b> {
    words: SplitAsciiWhitespace<'b>,
    fields: &'a mut Vec<Field>,
}

impl Parser<'_, '_> {
    /// Parses a structure from its opening bracket on; columns are named after `name`.
    fn structure(&mut self, name: &str) -> Option<Structure> {
        self.words.next().filter(|&word| word == "(")?;
        match self.words.next()? {
            "fixed" => self.octets(name).map(Structure::Fixed),
            "extended" => self.extended(name),
            "repeated" => self.repeated(),
            "compound" => self.compound(name),
            "sequence" => self.words.next().map(|_| Structure::Sequence),
            "explicit" => self.words.next().map(|_| Structure::Explicit),
            _ => None,
        }
    }

    /// Parses the number of bits, the fields and the closing bracket.
    fn octets(&mut self, name: &str) -> Option<Octets> {
        let count = self.number()?.div_ceil(8);
        let mut bits = Vec::new();
        while self.words.next()? == "(" {
            let part = self.words.next()?;
            let (first, count) = (self.number()?, self.number()?);
            let signed = self.words.next()? == "s";
            let rest: Vec<&str> = self.words.by_ref().take_while(|&word| word != ")").collect();
            let field = Field {
                name: if part == "=" { name.into() } else { format!("{name}/{part}") },
                scale: rest.first().map_or(Some(1.0), |text| text.parse().ok())?,
                unit: rest.get(1).copied().unwrap_or_default().into(),
            };
            // an item that is in both lists of a category has the same columns in both
            let known = self.fields.iter().position(|one| *one == field);
            let column = known.unwrap_or(self.fields.len());
            if known.is_none() {
                self.fields.push(field);
            }
            bits.push(Bits { column, first, count, signed });
        }
        Some(Octets { count, bits })
    }

    fn extended(&mut self, name: &str) -> Option<Structure> {
        let (mut parts, mut open) = (Vec::new(), true);
        while self.words.next()? == "(" {
            open = self.words.next()? == "fx";
            parts.push(self.octets(name)?);
        }
        Some(Structure::Extended(parts, open))
    }

    fn repeated(&mut self) -> Option<Structure> {
        let count = self.words.next()?;
        let Structure::Fixed(octets) = self.structure("")? else {
            return None;
        };
        self.words.next()?;
        Some(match count.parse() {
            Ok(count) => Structure::Counted(count, octets.count),
            Err(_) => Structure::Repeated(octets.count),
        })
    }

    fn compound(&mut self, name: &str) -> Option<Structure> {
        let fspec = self.number()?;
        let mut items = Vec::new();
        loop {
            match self.words.next()? {
                ")" => break,
                "-" => items.push(None),
                part => items.push(Some(self.structure(&format!("{name}/{part}"))?)),
            }
        }
        Some(Structure::Compound(Items { fspec, items, other: None }))
    }

    fn number(&mut self) -> Option<usize> {
        self.words.next()?.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;
    use std::iter;

    #[test]
    fn all_of_the_text_is_read() {
        let text = include_str!("definitions.txt");
        assert_eq!(definitions().len(), text.matches("\ncategory ").count());
        for one in definitions() {
            let head = format!("\ncategory {} {}\n", one.category, one.editions.join(" "));
            let paragraph = text.split(&head).nth(1).unwrap().split("\n\n").next().unwrap();
            let lists = iter::once(&one.record).chain(one.record.other.iter().map(|(_, it)| &**it));
            let lists: Vec<_> = lists.collect();
            let written = paragraph.lines().count() - 2 * lists.len() + 1;
            let spare = paragraph.lines().filter(|&line| line == "-").count();
            assert_eq!(lists.iter().map(|list| list.items.len()).sum::<usize>(), written);
            let items = lists.iter().flat_map(|list| &list.items);
            assert_eq!(items.filter(|item| item.is_none()).count(), spare);
            // the FSPEC has no octet beyond the last item
            assert!(lists.iter().all(|list| list.items.len().div_ceil(7) == list.fspec));
            let written = paragraph.matches(" u").count() + paragraph.matches(" s ").count();
            let names: HashSet<_> = one.fields.iter().map(|field| &field.name).collect();
            assert_eq!(names.len(), one.fields.len());
            // fields that are in both lists are written twice
            let twice = if lists.len() == 1 { 0 } else { 16 };
            assert_eq!(one.fields.len() + twice, written);
        }
    }

    #[test]
    fn fields_have_names_and_scales() {
        let plots = definitions().iter().find(|one| one.category == 48).unwrap();
        assert_eq!(plots.editions[0], "1.32");
        let range = plots.fields.iter().find(|one| one.name == "040/RHO").unwrap();
        assert_eq!((range.scale, range.unit.as_str()), (1.0 / 256.0, "NM"));
        let tracks = definitions().iter().find(|one| one.category == 62).unwrap();
        assert!(tracks.fields.iter().any(|one| one.name == "500/APC/X" && one.scale == 0.5));
    }
}
